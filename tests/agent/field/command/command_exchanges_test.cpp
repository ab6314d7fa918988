#include "agent/field/command/command_exchanges.h"

#include <gtest/gtest.h>

#include "agent/commands/result.h"
#include "protocol/catalog.h"
#include "protocol/plan/plan.h"
#include "tests/agent/field/field_plant.h"
#include "tests/agent/field/port_frames.h"
#include "tests/agent/field/scripted_bus.h"
#include "tests/support/says.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;

const Bytes kWrite50 = write_frame(kD200, word(50));
const Bytes kReadBack = read_frame(kD200, 2);

/// One line with a PLC that needs no enquiry, and one word, D200.
struct CommandExchangesTest : ScriptedBusTest {
  CommandExchangesTest() {
    device.retries = 1;
    make_bus();
    station.codec = device.codec;
    station.enquire = EnquirePolicy::never;
    target.point = tag(*device.codec, "setpoint", "D200").point;
    admitted.deadline = Clock::now() + std::chrono::hours(1);
    write = plan_write(*device.codec, target.point, word(50)).value().at(0);
    exchanges = std::make_unique<CommandExchanges>(io.get_executor(), *bus, station, device, limits,
                                                   admitted, others);
  }
  Exchange send(bool may_repeat = true) {
    return run_on(io, exchanges->send_once_or_twice(write, may_repeat));
  }

  DeviceConfig device = port_device();
  std::vector<Holes::Limit> limits;  ///< found by polls
  AdmittedCommand admitted;
  AdmittedTarget target;
  Request write;
  Others others;
  std::unique_ptr<CommandExchanges> exchanges;
};

TEST_F(CommandExchangesTest, BytesThatAreNoAnswerAreToldWithWhatTheyLookLike) {
  // The line returns the request as an echo; there is no answer.
  wire->expect(kWrite50).give(kWrite50).silence();
  const Exchange exchange = send(false);
  EXPECT_EQ(exchange.outcome, Exchange::Outcome::unanswered);
  expect_says(exchange.error, "; it looks like the request itself, which the line returns");
}

TEST_F(CommandExchangesTest, OfBytesThatLookLikeNothingNothingIsClaimed) {
  wire->expect(kWrite50).give({0x07}).silence();
  const Exchange exchange = send(false);
  EXPECT_FALSE(exchange.has_answer());
  EXPECT_EQ(exchange.error.find("looks like"), std::string::npos) << exchange.error;
}

TEST_F(CommandExchangesTest, ClosedLineIsOpenedAndTheWriteLeavesOnce) {
  wire->expect(kWrite50).give(kAck);
  EXPECT_TRUE(send().is_ack());
  EXPECT_EQ(wire->opened(), 1U);
  EXPECT_EQ(exchanges->writes(), 1);
  EXPECT_TRUE(exchanges->was_answered());
  EXPECT_FALSE(exchanges->was_unanswered());
  EXPECT_EQ(exchanges->used(), exchanges->last_byte() - *exchanges->first_byte());
}

TEST_F(CommandExchangesTest, RefusedWriteIsSentOnceMoreWhereThatIsAllowed) {
  wire->expect(kWrite50).give(kNak).expect(kWrite50).give(kAck);
  EXPECT_TRUE(send().is_ack());
  EXPECT_EQ(exchanges->writes(), 2);
  wire->expect(kWrite50).give(kNak);
  EXPECT_TRUE(send(/*may_repeat=*/false).is_nak());
  EXPECT_EQ(exchanges->writes(), 3);
}

TEST_F(CommandExchangesTest, UnansweredWriteIsNotSentAgain) {
  wire->expect(kWrite50).silence();
  EXPECT_EQ(send().outcome, Exchange::Outcome::unanswered);
  EXPECT_EQ(exchanges->writes(), 1);
  EXPECT_TRUE(exchanges->was_unanswered());
}

TEST_F(CommandExchangesTest, PollsRunBetweenASilenceAndTheNextExchange) {
  const auto read = [&] { return run_on(io, exchanges->read_point(target)).image.has_value(); };
  wire->expect(kReadBack).silence();
  EXPECT_FALSE(read());
  EXPECT_GT(others.silence, nanoseconds(0));
  EXPECT_EQ(others.turns_after_silence, 0) << "the result need not wait for polls";
  for (int i = 0; i < 2; ++i) {
    wire->expect(kReadBack).give(word_frame(50));
    EXPECT_TRUE(read());
    EXPECT_EQ(others.turns_after_silence, 1);
  }
}

TEST_F(CommandExchangesTest, SilenceIsLineTimeOfTheCommandIfNoPollHasRunAfterIt) {
  const auto read_twice = [&] {
    wire->expect(kReadBack).silence();
    run_on(io, exchanges->read_point(target));
    wire->expect(kReadBack).give(word_frame(50));
    run_on(io, exchanges->read_point(target));
    return exchanges->last_byte() - *exchanges->first_byte();
  };
  others.polls_run = false;
  const nanoseconds both = read_twice();
  EXPECT_EQ(exchanges->used(), both);
  others.polls_run = true;
  const nanoseconds all = read_twice();
  EXPECT_LT(exchanges->used(), all);
}

TEST_F(CommandExchangesTest, NothingBeginsAfterTheExpiryButWhatIsUnderWayIsFinished) {
  admitted.deadline = Clock::now() - milliseconds(1);
  EXPECT_EQ(send().outcome, Exchange::Outcome::expired);
  EXPECT_EQ(wire->opened(), 0U);
  EXPECT_FALSE(exchanges->first_byte());
  admitted.deadline = Clock::now() + std::chrono::hours(1);
  wire->expect(kWrite50).give(kAck);
  send();
  admitted.deadline = Clock::now() - milliseconds(1);
  wire->expect(kWrite50).give(kAck);
  EXPECT_TRUE(send().is_ack()) << "the next part of a command whose first write has left";
}

TEST_F(CommandExchangesTest, WriteThatWouldNotBeThroughInTimeDoesNotBegin) {
  admitted.deadline = Clock::now() + std::chrono::minutes(1);
  admitted.line_time = std::chrono::minutes(2);
  EXPECT_EQ(send().outcome, Exchange::Outcome::expired);
}

TEST_F(CommandExchangesTest, ReadIsRepeatedAsOftenAsTheConfigAllows) {
  wire->expect(kReadBack).give(kNak).expect(kReadBack).give(word_frame(50));
  const auto got = run_on(io, exchanges->read_point(target));
  EXPECT_EQ(got.image, word(50));
  wire->expect(kReadBack).give(kNak).expect(kReadBack).give(kNak);
  const auto refused = run_on(io, exchanges->read_point(target));
  EXPECT_FALSE(refused.image);
  EXPECT_TRUE(refused.last.is_nak());
  EXPECT_EQ(exchanges->writes(), 0);
}

TEST_F(CommandExchangesTest, TimeOfAReadIsComparedBeforeEachOfItsExchanges) {
  device.max_block_bytes = 2;
  target.point = tag(*device.codec, "wide", "D200", DataType::int32).point;
  admitted.line_time = std::chrono::minutes(1);
  wire->expect(kReadBack);
  wire->call([&] { admitted.deadline = Clock::now() - milliseconds(1); });
  wire->give(word_frame(50));
  EXPECT_EQ(run_on(io, exchanges->read_point(target)).last.outcome, Exchange::Outcome::expired);
  EXPECT_EQ(exchanges->latest_start(), admitted.deadline) << "the whole command has begun in time";
}

TEST_F(CommandExchangesTest, OthersHaveTheirTurnAndTheLineTimeBeginsAnew) {
  wire->expect(kWrite50).give(kAck);
  send();
  const nanoseconds used = exchanges->used();
  EXPECT_TRUE(run_on(io, exchanges->go_on(/*share=*/false)));
  EXPECT_EQ(others.turns, 0);
  EXPECT_TRUE(run_on(io, exchanges->go_on(/*share=*/true)));
  EXPECT_EQ(others.turns, 1);
  EXPECT_EQ(others.used_before, used);
  EXPECT_EQ(exchanges->used(), nanoseconds(0));
}

TEST_F(CommandExchangesTest, StopLetsNobodyHaveATurnAndItsEndCutsOff) {
  others.stopping = true;
  EXPECT_FALSE(run_on(io, exchanges->go_on(/*share=*/true)));
  EXPECT_EQ(others.turns, 0);
  others.over = true;
  EXPECT_EQ(send().outcome, Exchange::Outcome::link_down);
  EXPECT_TRUE(exchanges->was_cut_off());
  EXPECT_TRUE(wire->written().empty());
}

TEST_F(CommandExchangesTest, UnitBehindAGatewayThatDoesNotAnswerIsToldWithWhatToLookAt) {
  device = device_on("modbus-tcp", codec_of("modbus-tcp"));
  station.codec = device.codec;
  station.wiring = {Wiring::Channel::tcp, "192.0.2.10:502"};
  target.point = tag(*device.codec, "r", "hr:0").point;
  const auto read = [&](std::string_view transaction, std::string_view answer) {
    wire->expect(*from_hex(std::string(transaction) + " 00 00 00 06 01 03 00 00 00 01"));
    wire->give(*from_hex(std::string(transaction) + std::string(answer)));
    return run_on(io, exchanges->read_point(target)).last.reply.text;
  };
  const std::string silent = read("00 01", " 00 00 00 03 01 83 0B");
  expect_says(silent,
              "\": the gateway 192.0.2.10:502 answers, but the device behind it does not. Check: ");
  EXPECT_EQ(read("00 02", " 00 00 00 03 01 83 02").find("Check: "), std::string::npos)
      << "the device's own refusal";
}

/// The same with a protocol that hints where to look for the cause.
struct HintingExchangesTest : CommandExchangesTest {
  HintingExchangesTest() {
    hinting.hints.silent = "is it switched on";
    hinting.hints.closed = "is another program using this connection?";
    device.protocol = &hinting;
  }
  ProtocolInfo hinting = *find_protocol("fx-programming-port");
};

TEST_F(HintingExchangesTest, DeviceThatHasNeverAnsweredIsToldWithWhatToLookAt) {
  wire->hang_up();  // during the drain
  const std::string closed = send().error;
  expect_says(closed, "; is another program");
  wire->silence().expect(kWrite50).silence();
  const std::string silent = send().error;
  EXPECT_EQ(silent.find("no answer on "), 0U) << silent;
  expect_says(silent, "; is it switched on; ");
}

TEST_F(HintingExchangesTest, DeviceThatHasAnsweredHasTheRightSettings) {
  wire->silence().expect(kWrite50).give(kAck);
  wire->expect(kWrite50).silence();
  EXPECT_TRUE(send().is_ack());
  const std::string silent = send().error;
  EXPECT_FALSE(silent.empty());
  EXPECT_EQ(silent.find("; is it"), std::string::npos) << silent;
}

}  // namespace
}  // namespace fxagent::test
