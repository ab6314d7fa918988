#include "agent/field/line.h"

#include <gtest/gtest.h>

#include <asio/io_context.hpp>
#include <asio/post.hpp>
#include <memory>
#include <string>
#include <utility>

#include "protocol/fx/computer_link.h"
#include "tests/agent/field/field_plant.h"
#include "tests/agent/field/on_io.h"
#include "tests/agent/field/port_frames.h"
#include "tests/support/scripted_transport.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;
using Outcome = Exchange::Outcome;

const Bytes kReadD100 = read_frame(kD100, 2);
const Bytes kReadD200 = read_frame(kD200, 2);
const Bytes kWriteD200 = write_frame(kD200, word(50));
const Bytes kProbe = read_frame(kM8000, 1);
const Bytes kProbeAnswer = data_frame({0x01});

/// One line with one PLC on the programming port.
class LineTest : public ::testing::Test {
 protected:
  LineTest() {
    auto transport = std::make_unique<ScriptedTransport>(io.get_executor());
    wire = transport.get();
    line = std::make_unique<Line>(io.get_executor(), std::move(transport), nanoseconds(0));
    station.codec = codec.get();
  }
  ~LineTest() override { EXPECT_EQ(wire->steps_left(), 0U) << "the script was not played out"; }

  void open() {
    const auto opened = run_on(io, line->open());
    ASSERT_TRUE(opened) << opened.error().text;
  }
  Exchange ask(Request request, SteadyTime not_after = SteadyTime::max()) {
    return run_on(io, line->exchange(station, std::move(request), not_after));
  }
  Exchange read(std::string_view address) { return ask(request_for(address)); }
  Exchange write_d200(unsigned value = 50) {
    return ask(Write{codec->parse_address("D200", {})->span, word(value)});
  }
  Request request_for(std::string_view address) const {
    return Read{codec->parse_address(address, {})->span};
  }

  std::shared_ptr<const Codec> codec = port_codec();
  asio::io_context io;
  ScriptedTransport* wire = nullptr;
  std::unique_ptr<Line> line;
  Station station;
};

// ---- the plain case
// ------------------------------------------------------------------------------

TEST_F(LineTest, EnquiresOnceAfterOpeningAndThenJustAsks) {
  wire->expect(kEnq).give(kAck);
  wire->expect(kReadD100).give(word_frame(234));
  wire->expect(kReadD100).give(word_frame(235));
  open();
  const Exchange first = read("D100");
  EXPECT_TRUE(first.is_data());
  EXPECT_TRUE(first.sent);
  EXPECT_EQ(first.reply.image, word(234));
  EXPECT_LE(first.began, first.ended);
  EXPECT_GT(first.ended_ms, 0);
  EXPECT_EQ(read("D100").reply.image, word(235));
}

TEST_F(LineTest, EnquiresAgainAfterTheNextOpening) {
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(1));
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(2));
  open();
  EXPECT_TRUE(read("D100").is_data());
  line->close();
  open();
  EXPECT_TRUE(read("D100").is_data());
}

TEST_F(LineTest, EnquiresBeforeEachRequestWhereThePolicySaysAlways) {
  station.enquire = EnquirePolicy::always;
  for (unsigned i = 0; i < 2; ++i)
    wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(i));
  open();
  EXPECT_TRUE(read("D100").is_data());
  EXPECT_TRUE(read("D100").is_data());
}

TEST_F(LineTest, NeverEnquiresWhereThePolicySaysNever) {
  station.enquire = EnquirePolicy::never;
  wire->expect(kReadD100).give(word_frame(1)).expect(kReadD100).give(word_frame(2));
  open();
  EXPECT_TRUE(read("D100").is_data());
  EXPECT_TRUE(read("D100").is_data());
}

TEST_F(LineTest, ReplyMayComeInPieces) {
  const Bytes reply = word_frame(0x15AB);
  for (std::size_t cut = 1; cut < reply.size(); ++cut) {
    wire->expect(kReadD100).give({reply.begin(), reply.begin() + static_cast<long>(cut)});
    wire->give({reply.begin() + static_cast<long>(cut), reply.end()});
  }
  station.enquire = EnquirePolicy::never;
  open();
  for (std::size_t cut = 1; cut < reply.size(); ++cut)
    EXPECT_EQ(read("D100").reply.image, word(0x15AB)) << "cut after " << cut;
}

TEST_F(LineTest, EchoOfTheRequestIsNoAnswer) {
  wire->expect(kEnq).give(joined(kEnq, kAck));
  wire->expect(kReadD100).give(kReadD100).give(word_frame(7));
  wire->expect(kWriteD200).give(joined(kWriteD200, kAck));
  open();
  EXPECT_EQ(read("D100").reply.image, word(7));
  EXPECT_TRUE(write_d200().is_ack());
}

TEST_F(LineTest, EchoAloneIsSilence) {
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(kReadD100);
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::unanswered);
}

TEST_F(LineTest, EchoThatTheLineIsSaidToReturnIsTakenOff) {
  station.echo = true;
  wire->expect(kEnq).give(kEnq).give(kAck);
  wire->expect(kWriteD200).give(Bytes{0x00}).give(kWriteD200).give(kAck);
  wire->expect(kWriteD200).give(kWriteD200).silence();  // an echo is no answer
  open();
  EXPECT_TRUE(write_d200().is_ack());
  const Exchange unanswered = write_d200();
  EXPECT_EQ(unanswered.outcome, Outcome::unanswered);
  EXPECT_EQ(unanswered.error.find("echo"), std::string::npos);
}

TEST_F(LineTest, EchoThatDoesNotComeIsNamed) {
  station.echo = true;
  station.enquire = EnquirePolicy::never;
  wire->expect(kReadD100).give(word_frame(234)).silence();
  open();
  const Exchange answer = read("D100");
  EXPECT_EQ(answer.outcome, Outcome::unanswered);
  EXPECT_NE(answer.error.find("not even the echo"), std::string::npos) << answer.error;
}

TEST_F(LineTest, EchoThatNobodyToldOfIsFoundByThreeReads) {
  station.enquire = EnquirePolicy::never;
  const Bytes data = word_frame(234);
  for (int i = 0; i < 3; ++i) wire->expect(kReadD100).give(kReadD100).give(data);
  wire->expect(kWriteD200).give(kWriteD200).give(kAck);
  wire->expect(kReadD100).give(data);
  open();
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(line->echo_found());
    EXPECT_TRUE(read("D100").is_data());
  }
  EXPECT_TRUE(line->echo_found());
  EXPECT_TRUE(write_d200().is_ack());
  EXPECT_TRUE(read("D100").is_data()) << "a read without an echo is a read";
  EXPECT_FALSE(line->echo_found());
}

TEST_F(LineTest, NoiseBeforeTheReplyIsPassedOver) {
  wire->expect(kEnq).give({0x00, 0xFF, 0x06});
  wire->expect(kReadD100).give(joined({0xFF, 0x7F, 0x00}, word_frame(7)));
  open();
  EXPECT_EQ(read("D100").reply.image, word(7));
}

TEST_F(LineTest, NakIsAnAnswer) {
  wire->expect(kEnq).give(kAck).expect(kWriteD200).give(kNak).expect(kReadD100).give(word_frame(1));
  open();
  const Exchange refused = write_d200();
  EXPECT_TRUE(refused.is_nak());
  EXPECT_TRUE(refused.sent);
  EXPECT_TRUE(read("D100").is_data()) << "nothing to clear up after a NAK";
}

// ---- lines that say nothing, or nonsense
// ---------------------------------------------------------

TEST_F(LineTest, EnquiryThatNobodyAnswersSendsNothingElse) {
  wire->expect(kEnq);
  open();
  const Exchange exchange = write_d200();
  EXPECT_EQ(exchange.outcome, Outcome::unanswered);
  EXPECT_FALSE(exchange.sent) << "the order has not left";
  EXPECT_FALSE(exchange.error.empty());
  EXPECT_EQ(wire->written().size(), 1U);
}

TEST_F(LineTest, DrainsAndEnquiresAfterASilence) {
  wire->expect(kEnq).give(kAck);
  wire->expect(kReadD100).silence();
  wire->silence();  // the drain: quiet
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(7));
  open();
  const Exchange silent = read("D100");
  EXPECT_EQ(silent.outcome, Outcome::unanswered);
  EXPECT_TRUE(silent.sent);
  EXPECT_EQ(read("D100").reply.image, word(7));
}

TEST_F(LineTest, LateReplyIsNotTakenForTheNextAnswer) {
  // Both replies have the same shape: nothing but the order of things tells them apart.
  wire->expect(kEnq).give(kAck);
  wire->expect(kReadD100).silence();
  wire->give(word_frame(1)).silence();                   // it comes during the drain
  wire->expect(kEnq).give(joined(word_frame(1), kAck));  // or after the enquiry
  wire->expect(kReadD200).give(word_frame(2));
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::unanswered);
  EXPECT_EQ(read("D200").reply.image, word(2));
}

TEST_F(LineTest, LateReplyBetweenDrainAndEnquiryIsThrownAway) {
  wire->expect(kEnq).give(kAck);
  wire->expect(kReadD100).silence();
  wire->silence().give(joined(word_frame(1), kNak));
  wire->expect(kEnq).give(kAck).expect(kReadD200).give(word_frame(2));
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::unanswered);
  EXPECT_EQ(read("D200").reply.image, word(2));
}

TEST_F(LineTest, LateReplyHasItsTimeWhereNobodyAnswersTheResync) {
  // EOT of a computer link has no answer that would tell what came before it.
  codec = std::make_shared<fx::ComputerLink>(fx::ComputerLink::Settings{});
  station.codec = codec.get();
  station.timeout = milliseconds(150);
  const Read d100{codec->parse_address("D100", {})->span, fx::ComputerLink::kWordWay};
  const Bytes question = *codec->encode(d100, 0);
  const Bytes eot = *codec->encode(*codec->resync(), 0);
  wire->expect(eot).expect(question).silence();
  wire->hang();  // the drain, in truth until its end
  wire->expect(eot).expect(question).silence();
  open();
  const Exchange first = ask(d100);
  const Exchange second = ask(d100);
  EXPECT_EQ(first.outcome, Outcome::unanswered);
  EXPECT_GE(second.began - first.ended, station.timeout);
}

TEST_F(LineTest, LateAckIsNotTakenForTheAckOfTheNextWrite) {
  // The write's ACK comes so late that it answers the enquiry; the enquiry's own would then answer
  // the next write. The read between them cannot be answered by an ACK, and what comes before its
  // data is older.
  wire->expect(kEnq).give(kAck);
  wire->expect(kWriteD200).silence();
  wire->silence();
  wire->expect(kEnq).give(kAck);                          // in truth the write's
  wire->expect(kProbe).give(joined(kAck, kProbeAnswer));  // the enquiry's, then the data
  wire->expect(write_frame(kD200, word(60))).silence();   // nobody acknowledges this one
  open();
  EXPECT_EQ(write_d200(50).outcome, Outcome::unanswered);
  EXPECT_EQ(write_d200(60).outcome, Outcome::unanswered);
}

TEST_F(LineTest, LateAckIsNotTakenForAnotherWithoutAnEnquiryEither) {
  station.enquire = EnquirePolicy::never;
  wire->expect(kWriteD200).silence();
  wire->silence();
  wire->expect(kProbe).give(joined(kAck, kProbeAnswer));
  wire->expect(write_frame(kD200, word(60))).silence();
  open();
  EXPECT_EQ(write_d200(50).outcome, Outcome::unanswered);
  EXPECT_EQ(write_d200(60).outcome, Outcome::unanswered);
}

TEST_F(LineTest, LateNakIsNotTakenForTheProbesAnswer) {
  station.enquire = EnquirePolicy::never;
  wire->expect(kWriteD200).silence();
  wire->silence();  // the drain
  wire->expect(kProbe).give(kNak).expect(kProbe).give(kProbeAnswer);
  wire->expect(kWriteD200).give(kAck);
  open();
  EXPECT_EQ(write_d200().outcome, Outcome::unanswered);
  EXPECT_TRUE(write_d200().is_ack());
}

TEST_F(LineTest, DeviceThatRefusesTheProbeForeverIsAskedAllTheSame) {
  station.enquire = EnquirePolicy::never;
  wire->expect(kWriteD200).silence();
  wire->silence();
  for (int i = 0; i < 3; ++i) wire->expect(kProbe).give(kNak);
  wire->expect(kWriteD200).give(kAck);
  open();
  EXPECT_EQ(write_d200().outcome, Outcome::unanswered);
  EXPECT_TRUE(write_d200().is_ack());
}

TEST_F(LineTest, LostAckStaysAWorryUntilAReadWasAnswered) {
  wire->expect(kEnq).give(kAck);
  wire->expect(kWriteD200).silence();
  wire->expect(kEnq).give(kAck).expect(kProbe).silence();  // no barrier yet
  wire->expect(kEnq)
      .give(kAck)
      .expect(kProbe)
      .give(kProbeAnswer)
      .expect(kReadD100)
      .give(word_frame(1));
  wire->expect(kWriteD200).give(kAck);  // the worry is over
  open();
  EXPECT_EQ(write_d200().outcome, Outcome::unanswered);
  const Exchange unsure = read("D100");
  EXPECT_EQ(unsure.outcome, Outcome::unanswered);
  EXPECT_FALSE(unsure.sent);
  EXPECT_TRUE(read("D100").is_data());
  EXPECT_TRUE(write_d200().is_ack());
}

TEST_F(LineTest, LateAckIsNotTakenForAnotherAfterAReconnection) {
  // A serial server hands what its PLC said last to whoever is connected now.
  wire->expect(kEnq).give(kAck);
  wire->expect(kWriteD200).hang_up();
  wire->silence();                                        // quiet after opening, and still to come:
  wire->expect(kEnq).give(kAck);                          // the lost write's ACK
  wire->expect(kProbe).give(joined(kAck, kProbeAnswer));  // the enquiry's
  wire->expect(write_frame(kD200, word(60))).silence();
  open();
  EXPECT_EQ(write_d200(50).outcome, Outcome::link_down);
  open();
  EXPECT_EQ(write_d200(60).outcome, Outcome::unanswered);
}

TEST_F(LineTest, BadSumIsGarbledAndTheLineIsPutInOrder) {
  Bytes wrong = word_frame(7);
  wrong.back() = wrong.back() == '0' ? '1' : '0';
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(wrong);
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(7));
  open();
  const Exchange garbled = read("D100");
  EXPECT_EQ(garbled.outcome, Outcome::garbled);
  EXPECT_NE(garbled.error.find("sum"), std::string::npos) << garbled.error;
  EXPECT_EQ(read("D100").reply.image, word(7));
}

TEST_F(LineTest, BabblingLineEndsTheExchange) {
  wire->expect(kEnq).give(kAck).expect(kReadD100);
  for (int i = 0; i < 9; ++i) wire->give(Bytes(512, 0x55));
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::garbled);
  wire->discard_input();
}

TEST_F(LineTest, InputThatNobodyAskedForIsThrownAwayBeforeARequest) {
  wire->expect(kEnq).give(kAck);
  wire->expect(kReadD100).give(joined(word_frame(1), {0x55, 0x55}));
  wire->give(word_frame(99));  // arrives between two requests
  wire->expect(kReadD100).give(word_frame(2));
  open();
  EXPECT_EQ(read("D100").reply.image, word(1));
  EXPECT_EQ(read("D100").reply.image, word(2));
}

TEST_F(LineTest, WhatAnEarlierSessionLeftRunsDryOnOpening) {
  wire->give(word_frame(99)).give(kAck).silence();
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(2));
  open();
  EXPECT_EQ(read("D100").reply.image, word(2));
}

// ---- time
// ----------------------------------------------------------------------------------------

TEST_F(LineTest, OrderWhoseTimeHasPassedIsNotSent) {
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(1));
  open();
  read("D100");
  const Exchange late = ask(request_for("D200"), Clock::now() - milliseconds(1));
  EXPECT_EQ(late.outcome, Outcome::expired);
  EXPECT_FALSE(late.sent);
}

TEST_F(LineTest, TimeIsCheckedAfterEverythingThatPrecedesTheFirstByte) {
  // The enquiry takes its time: what was fresh before it need not be fresh after it.
  SteadyTime not_after = Clock::now() + milliseconds(20);
  wire->expect(kEnq);
  wire->call([&] {
    while (Clock::now() <= not_after) {
    }
  });
  wire->give(kAck);
  open();
  not_after = Clock::now() + milliseconds(20);
  const Exchange late = ask(request_for("D100"), not_after);
  EXPECT_EQ(late.outcome, Outcome::expired);
  EXPECT_FALSE(late.sent);
}

TEST_F(LineTest, GapIsKeptBetweenTwoRequests) {
  station.gap = milliseconds(15);
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(1));
  wire->expect(kReadD100).give(word_frame(2));
  open();
  const Exchange first = read("D100");
  const Exchange second = read("D100");
  EXPECT_GE(second.began - first.ended, milliseconds(15));
}

TEST_F(LineTest, ReadWaitsForItsDeadlineAndNoLonger) {
  station.timeout = milliseconds(5);
  wire->expect(kEnq).give(kAck).expect(kReadD100).hang();
  open();
  const Exchange exchange = read("D100");
  EXPECT_EQ(exchange.outcome, Outcome::unanswered);
  EXPECT_GE(exchange.ended - exchange.began, milliseconds(5));
}

// ---- links that break
// ----------------------------------------------------------------------------

TEST_F(LineTest, LinkLostBeforeTheFirstByteSendsNothing) {
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(1)).hang_up();
  open();
  read("D100");
  const Exchange exchange = write_d200();
  EXPECT_EQ(exchange.outcome, Outcome::link_down);
  EXPECT_FALSE(exchange.sent);
  EXPECT_FALSE(line->is_open());
  EXPECT_FALSE(exchange.error.empty());
}

TEST_F(LineTest, WriteThatBreaksBeforeItsFirstByteWasNotSent) {
  wire->expect(kEnq).give(kAck).break_write(0);
  open();
  const Exchange exchange = write_d200();
  EXPECT_EQ(exchange.outcome, Outcome::link_down);
  EXPECT_FALSE(exchange.sent);
  EXPECT_FALSE(line->is_open());
}

TEST_F(LineTest, WriteThatBreaksAfterOneByteWasSent) {
  wire->expect(kEnq).give(kAck).break_write(1);
  open();
  const Exchange exchange = write_d200();
  EXPECT_EQ(exchange.outcome, Outcome::link_down);
  EXPECT_TRUE(exchange.sent);
}

TEST_F(LineTest, LinkLostWhileWaitingWasSent) {
  wire->expect(kEnq).give(kAck).expect(kWriteD200).hang_up();
  open();
  const Exchange exchange = write_d200();
  EXPECT_EQ(exchange.outcome, Outcome::link_down);
  EXPECT_TRUE(exchange.sent);
  EXPECT_FALSE(line->is_open());
}

TEST_F(LineTest, LinkLostDuringTheEnquirySendsNothingElse) {
  wire->expect(kEnq).hang_up();
  open();
  const Exchange exchange = write_d200();
  EXPECT_EQ(exchange.outcome, Outcome::link_down);
  EXPECT_FALSE(exchange.sent);
}

TEST_F(LineTest, LinkLostDuringTheDrainSendsNothing) {
  wire->expect(kEnq).give(kAck).expect(kReadD100).silence().hang_up();
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::unanswered);
  const Exchange exchange = write_d200();
  EXPECT_EQ(exchange.outcome, Outcome::link_down);
  EXPECT_FALSE(exchange.sent);
}

TEST_F(LineTest, ClosingEndsAWaitingExchange) {
  station.timeout = std::chrono::hours(1);
  wire->expect(kEnq).give(kAck).expect(kReadD100).call(
      [&] { asio::post(io, [&] { line->close(); }); });
  wire->hang();
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::link_down);
}

TEST_F(LineTest, ChannelThatWillNotOpenSaysWhy) {
  wire->refuse_open("no such adapter");
  const auto opened = run_on(io, line->open());
  ASSERT_FALSE(opened);
  EXPECT_EQ(opened.error().code, ErrorCode::link_down);
  EXPECT_EQ(opened.error().text, "no such adapter");
  EXPECT_FALSE(line->is_open());
}

TEST_F(LineTest, PeerThatGoesRightAfterOpeningIsAFailureToOpen) {
  wire->hang_up();
  const auto opened = run_on(io, line->open());
  EXPECT_FALSE(opened);
  EXPECT_FALSE(line->is_open());
}

// ---- what is counted
// -----------------------------------------------------------------------------

TEST_F(LineTest, EachEndOfAnExchangeIsCounted) {
  Bytes wrong = word_frame(7);
  wrong.back() = wrong.back() == '0' ? '1' : '0';
  station.enquire = EnquirePolicy::never;
  wire->expect(kReadD100).give(word_frame(1));
  wire->expect(kWriteD200).give(kNak);
  wire->expect(kReadD100).give(wrong);
  wire->expect(kReadD100).silence();
  open();
  read("D100");
  write_d200();
  read("D100");
  read("D100");
  ask(request_for("D100"), Clock::now() - milliseconds(1));
  const Line::Counters& counters = line->counters();
  EXPECT_EQ(counters.exchanges, 4U) << "the one that expired was never sent";
  EXPECT_EQ(counters.naks, 1U);
  EXPECT_EQ(counters.bad_frames, 1U);
  EXPECT_EQ(counters.timeouts, 1U);
  EXPECT_GT(counters.busy.count(), 0);
  EXPECT_GE(counters.turnaround_ms.percentiles().p99, counters.turnaround_ms.percentiles().p50);
}

}  // namespace
}  // namespace fxagent::test
