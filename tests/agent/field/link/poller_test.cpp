#include "agent/field/link/poller.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <asio/io_context.hpp>

#include "agent/commands/result.h"
#include "agent/line_time.h"
#include "tests/agent/field/fake_port.h"
#include "tests/agent/field/poller_plant.h"
#include "tests/agent/field/port_frames.h"
#include "tests/support/says.h"

namespace fxagent::test {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;
using State = DeviceStatus::State;

const Bytes kReadD100 = read_frame(kD100, 2);

// ---- a PLC on the programming port --------------------------------------------------------------

/// D100 in a group without an interval.
struct PortPolls : PollerTest {
  explicit PortPolls(fx::Model model = fx::Model::fx3u) {
    config.links.push_back({"line1", SerialSettings{}, nanoseconds(0)});
    config.devices.push_back(port_device("press1", port_codec(model)));
    add_tag("temp", "D100");
  }
  void add_tag(std::string name, std::string_view address) {
    DeviceConfig& device = config.devices[0];
    device.tags.push_back(tag(*device.codec, std::move(name), address));
  }
  Bytes answer(ByteView request) override { return plc.answer(request); }
  /// Starts without polls, as for a single command, on a PLC that is an FX2N.
  void ask_another_model() {
    config.devices[0].tags.clear();
    plc.set(kM8000, {0x01});
    plc.set(kD8001, word(24310));
    plc.set(kD8101, word(24310));
    start();
    poller->add_question(*devices[0]);
  }

  FakePort plc;
};

TEST_F(PortPolls, SamplesAreNumberedAndKnowWhereTheyComeFrom) {
  plc.set(kD100, word(234));
  start();
  devices[0]->seq = 100;
  steps_until([&] { return telemetry.size() == 2; });
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(telemetry[i].seq, 101 + i);
    EXPECT_EQ(telemetry[i].device, 0U);
    EXPECT_EQ(telemetry[i].group, 0U);
    EXPECT_EQ(telemetry[i].readings.at(0).value, number(234));
  }
  EXPECT_EQ(devices[0]->collected, 2U);
  EXPECT_EQ(newest[0].state, State::online);
}

TEST_F(PortPolls, GroupsOfWholeSecondsBeginOnTheCommonGrid) {
  config.devices[0].groups[0].interval = milliseconds(1000);
  start();
  for (int cycle = 0; cycle < 3; ++cycle) {
    const PollScheduler::Job job = scheduler.next(now);
    ASSERT_EQ(job.kind, PollScheduler::Job::Kind::wait);
    EXPECT_EQ(job.until.time_since_epoch() % milliseconds(10), nanoseconds(0)) << cycle;
    step();
  }
  EXPECT_EQ(telemetry.size(), 3U);
}

TEST_F(PortPolls, TheSilenceBeforeEachRequestCountsAsLineTime) {
  config.devices[0].groups[0].interval = milliseconds(100);
  config.devices[0].gap = milliseconds(80);
  start();
  steps_until([&] { return telemetry.size() == 2; });
  EXPECT_GE(scheduler.load(), 0.8);
}

TEST_F(PortPolls, EachReadOfACycleIsAStepOfItsOwn) {
  add_tag("running", "M0");
  start();
  step();
  EXPECT_TRUE(telemetry.empty());
  step();
  ASSERT_EQ(telemetry.size(), 1U);
  EXPECT_EQ(telemetry[0].readings.size(), 2U);
  ASSERT_TRUE(telemetry[0].span_ms);
}

TEST_F(PortPolls, ReadThatIsRefusedIsOfferedAgainInTheSameCycle) {
  script().expect(kEnq).give(kAck);
  wire->expect(kReadD100).give(kNak).expect(kReadD100).give(kNak);
  wire->expect(kReadD100).give(word_frame(7));
  start();
  step();
  step();
  EXPECT_TRUE(telemetry.empty()) << "commands that wait may go between the repeats";
  step();
  ASSERT_EQ(telemetry.size(), 1U);
  EXPECT_EQ(telemetry[0].readings[0].value, number(7));
  EXPECT_FALSE(telemetry[0].readings[0].bad);
}

TEST_F(PortPolls, ReadThatIsAlwaysRefusedIsBadAndItsDeviceDegraded) {
  script().then([](ByteView request) { return request.size() == 1 ? kAck : kNak; });
  start();
  steps_until([&] { return !telemetry.empty(); });
  EXPECT_EQ(wire->written().size(), 4U) << "an enquiry, and the read with both its repeats";
  EXPECT_EQ(telemetry[0].readings[0].bad, BadReason::nak);
  EXPECT_EQ(newest[0].state, State::degraded);
  EXPECT_EQ(newest[0].reason, "nak");
}

TEST_F(PortPolls, SilenceGivesUpTheRestOfTheCycle) {
  add_tag("running", "M0");
  plc.silent = true;
  config.devices[0].retries = 0;
  start();
  step();
  ASSERT_EQ(telemetry.size(), 1U);
  for (const TagReading& reading : telemetry[0].readings)
    EXPECT_EQ(reading.bad, BadReason::timeout);
  EXPECT_EQ(newest[0].state, State::offline);
  EXPECT_EQ(newest[0].reason, "timeout");
}

TEST_F(PortPolls, ClosedBusEndsTheCycleWithoutAnExchange) {
  start();
  bus->close();
  step();
  ASSERT_EQ(telemetry.size(), 1U);
  EXPECT_EQ(telemetry[0].readings[0].bad, BadReason::link_down);
  EXPECT_TRUE(wire->written().empty());
}

TEST_F(PortPolls, StoppedPollSaysNothing) {
  script().expect(kEnq).give(kAck).expect(kReadD100).call(
      [this] { state->stop(Reason::shutting_down); });
  wire->give(word_frame(7));
  start();
  step();
  EXPECT_TRUE(telemetry.empty());
}

TEST_F(PortPolls, GroupWithoutAnIntervalIsPolledOnceASecondWhileTheBrokerIsBehind) {
  start();
  step();
  ASSERT_EQ(telemetry.size(), 1U);
  outbox.set_backed_up(true);
  GroupPoll& group = *devices[0]->groups[0];
  group.began += std::chrono::hours(1);
  const std::size_t asked = plc.asked().size();
  step();
  EXPECT_EQ(plc.asked().size(), asked);
  EXPECT_EQ(scheduler.next(now).kind, PollScheduler::Job::Kind::wait);
  group.began = std::chrono::steady_clock::now() - std::chrono::seconds(1);
  steps_until([&] { return telemetry.size() == 2; });
  group.began += std::chrono::hours(1);
  outbox.set_backed_up(false);
  steps_until([&] { return telemetry.size() == 3; });
}

TEST_F(PortPolls, WrittenTagIsPublishedWhereItsGroupIsPolled) {
  start();
  poller->publish_written(*devices[0], 0, number(50), Poller::Origin::written);
  poller->publish_written(*devices[0], 0, number(51), Poller::Origin::read_back);
  devices[0]->groups.clear();
  poller->publish_written(*devices[0], 0, number(52), Poller::Origin::written);
  Outbox::Batch batch = outbox.take();
  ASSERT_EQ(batch.telemetry.size(), 2U);
  EXPECT_TRUE(batch.telemetry[0].written);
  EXPECT_FALSE(batch.telemetry[1].written);
  for (const Telemetry& message : batch.telemetry) EXPECT_TRUE(message.partial);
  EXPECT_EQ(batch.telemetry[1].seq, 2U);
}

TEST_F(PortPolls, RunStateIsAskedAndTold) {
  config.devices[0].groups[0].interval = hours(1);
  plc.set(kM8000, {0x01});
  start();
  poller->add_question(*devices[0]);
  steps_until([&] { return newest[0].run.has_value(); });
  EXPECT_EQ(newest[0].run, true);
  EXPECT_EQ(newest[0].state, State::online);
}

TEST_F(PortPolls, ALinkLostWhileItListensAddsNoLoad) {
  config.devices[0].groups[0].interval = hours(1);
  config.devices[0].tags.clear();
  script().expect(kEnq).give(kAck).expect(read_frame(kM8000, 1)).silence().later({0x55}).hang_up();
  start();
  poller->add_question(*devices[0]);
  for (int i = 0; i < 30 && bus->is_open(); ++i) step();
  EXPECT_FALSE(bus->is_open());
  EXPECT_LT(scheduler.load(), 1.0);
}

TEST_F(PortPolls, NoDoubtedReadIsBelievedNotEvenThatWhichEndsTheDoubt) {
  script().expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(7));
  wire->give(word_frame(99));
  for (int i = 0; i < 3; ++i) {
    wire->silence().expect(kEnq).give(kAck).expect(read_frame(kM8000, 1)).give(data_frame({0x01}));
    wire->expect(kReadD100).give(word_frame(111)).silence();
  }
  plc.set(kD100, word(222));
  start();
  const auto is_good = [](const Telemetry& message) { return bad(message) == 0; };
  steps_until(
      [&] { return !telemetry.empty() && telemetry.size() > 3 && is_good(telemetry.back()); });
  for (const Telemetry& message : telemetry)
    if (is_good(message)) {
      EXPECT_NE(message.readings[0].value, number(111));
    }
}

TEST_F(PortPolls, RunStateThatIsDoubtedIsNotKnown) {
  config.devices[0].tags.clear();
  const Bytes question = read_frame(kM8000, 1);
  const Bytes running = data_frame({0x01});
  script().expect(kEnq).give(kAck).expect(question).give(running);
  wire->expect(read_frame(kD8001, 2)).give(word_frame(24310));
  wire->expect(read_frame(kD8101, 2)).give(word_frame(16310));  // an FX3U, as configured
  start();
  poller->add_question(*devices[0]);
  steps_until([&] { return newest[0].run == true && wire->steps_left() == 0; });
  wire->give(word_frame(99)).silence().expect(kEnq).give(kAck);
  wire->expect(question).give(running);  // the probe
  wire->expect(question).give(running).silence();
  step();
  EXPECT_EQ(wire->steps_left(), 0U);
  EXPECT_EQ(newest[0].run, std::nullopt);
}

TEST_F(PortPolls, PlcOfAnotherModelThanTheConfigsIsLoggedAndToldOnce) {
  config.devices[0].groups[0].interval = hours(1);
  plc.set(kM8000, {0x01});
  plc.set(kD8001, word(24310));  // FX2N, repeated at D8101
  plc.set(kD8101, word(24310));
  testing::internal::CaptureStderr();
  start();
  poller->add_question(*devices[0]);
  steps_until([&] { return !newest[0].model_configured.empty(); });
  EXPECT_EQ(newest[0].model_configured, "FX3U");
  EXPECT_EQ(newest[0].model, "FX2N");
  ASSERT_NE(newest[0].codec_of_plc, nullptr) << "by which commands are judged";
  EXPECT_EQ(model_of(*newest[0].codec_of_plc), "FX2N");
  EXPECT_EQ(newest[0].state, State::online);
  const std::size_t asked = wire->written().size();
  step();
  step();
  EXPECT_LE(wire->written().size(), asked + 2) << "RUN alone, each time";
  const std::string log = testing::internal::GetCapturedStderr();
  expect_says(log, "warning device device=press1 model=FX2N model_configured=FX3U");
  EXPECT_EQ(log.find("model_configured=FX3U"), log.rfind("model_configured=FX3U")) << log;
}

TEST_F(PortPolls, TheFirstStateOfAPlcComesAfterItsModelIsCompared) {
  ask_another_model();
  steps_until([&] { return newest.contains(0); });
  EXPECT_EQ(newest[0].state, State::online);
  EXPECT_NE(newest[0].codec_of_plc, nullptr) << "a command that waits for it would not be judged";
}

struct LostAnswers : PortPolls {
  Bytes answer(ByteView request) override {
    const bool is_lost = std::ranges::equal(request, losing) && lost > 0;
    lost -= is_lost ? 1 : 0;
    return is_lost ? instead : PortPolls::answer(request);
  }
  /// Expects that a device without polls is asked again soon, and only then has a state of a PLC
  /// that answers.
  void expect_asked_again(Bytes question) {
    losing = std::move(question);
    ask_another_model();
    const SteadyTime began = now;
    steps_until([&] { return newest.contains(0) && newest[0].is_alive(); });
    EXPECT_EQ(lost, 0);
    EXPECT_NE(newest[0].codec_of_plc, nullptr) << "a lost answer switches another output";
    EXPECT_LT(now, began + kQuestionInterval);
  }

  Bytes losing;
  int lost = 1;
  Bytes instead;  ///< what arrives in place of the answer
};

TEST_F(LostAnswers, TheModelIsAskedForAgain) { expect_asked_again(read_frame(kD8001, 2)); }
TEST_F(LostAnswers, TheFirstQuestionIsAskedAgain) { expect_asked_again(read_frame(kM8000, 1)); }

TEST_F(LostAnswers, NoiseInEveryAnswerIsNotAskedForWithoutEnd) {
  losing = read_frame(kM8000, 1);
  constexpr int kEnough = 1000;
  lost = kEnough;
  instead = {0x02, 0x30, 0x31, 0x03, 0x30, 0x30};  // the sum would be 64
  config.devices[0].tags.clear();
  start();
  poller->add_question(*devices[0]);
  const SteadyTime began = now;
  steps_until([&] { return now >= began + kQuestionInterval - milliseconds(100); });
  const int retries = 1 + config.devices[0].retries;
  EXPECT_LE(kEnough - lost, 3 * retries);
}

// ---- a PLC without a configured model ----------------------------------------------------------

struct ModelPolls : PortPolls {
  ModelPolls() : PortPolls(fx::Model::unknown_fx) {
    add_tag("far", "D7000");
    plc.set(kD8001, word(24310));
    plc.set(kD8101, word(16310));
    plc.set(kD100, word(1));
    plc.set(0x4000 + 14000, word(2));
  }
};

TEST_F(ModelPolls, ModelIsAskedAndThePlanMadeAnew) {
  start();
  steps_until([&] { return !telemetry.empty(); });
  ASSERT_EQ(telemetry[0].readings.size(), 2U);
  EXPECT_EQ(telemetry[0].readings[0].value, number(1));
  EXPECT_EQ(telemetry[0].readings[1].value, number(2)) << "by the extended commands of an FX3U";
  EXPECT_EQ(bad(telemetry[0]), 0U);
  EXPECT_EQ(newest[0].model, "FX3U");
  EXPECT_EQ(plc.count("read 0E02 2"), 1U) << "asked once";
  EXPECT_GE(plc.count("E00 76B0 2"), 1U);
}

TEST_F(ModelPolls, ModelThatCannotBeToldStaysClassicAndDegraded) {
  plc.set(kD8101, word(0));
  start();
  steps_until([&] { return telemetry.size() == 3; });
  EXPECT_FALSE(telemetry[2].readings[0].bad);
  EXPECT_EQ(telemetry[2].readings[1].bad, BadReason::unsupported);
  EXPECT_EQ(newest[0].state, State::degraded);
  EXPECT_EQ(newest[0].reason, "model_unknown");
  EXPECT_TRUE(newest[0].model.empty());
  EXPECT_EQ(plc.count("read 0E02 2"), 1U);
}

TEST_F(ModelPolls, RefusalThatMayPassIsNoAnswerAndTheModelIsAskedAgain) {
  script().expect(kEnq).give(kAck);
  for (const unsigned address : {kD8001, kD8001, kD8101, kD8101})
    wire->expect(read_frame(address, 2)).give(kNak);
  start();
  steps_until([&] { return !telemetry.empty(); });
  EXPECT_EQ(telemetry[0].readings[0].bad, BadReason::nak);
  EXPECT_EQ(newest[0].reason, "nak");
  steps_until([&] { return newest[0].model == "FX3U"; });
  steps_until([&] { return newest[0].state == State::online; });
}

TEST_F(ModelPolls, OneRefusalDecidesNoModel) {
  script().expect(kEnq).give(kAck);
  wire->expect(read_frame(kD8001, 2)).give(word_frame(24310));
  wire->expect(read_frame(kD8101, 2)).give(kNak);  // noise: an FX3U does not refuse this
  start();
  steps_until([&] { return !telemetry.empty(); });
  EXPECT_EQ(newest[0].model, "FX3U");
}

TEST_F(ModelPolls, WhoRefusesTheSecondQuestionTwiceLacksIt) {
  script().expect(kEnq).give(kAck);
  wire->expect(read_frame(kD8001, 2)).give(word_frame(24310));
  for (int i = 0; i < 2; ++i) wire->expect(read_frame(kD8101, 2)).give(kNak);
  start();
  steps_until([&] { return !telemetry.empty(); });
  EXPECT_EQ(newest[0].model, "FX2N");
}

TEST_F(ModelPolls, ModelIsAskedAgainAfterASilence) {
  start();
  steps_until([&] { return newest[0].model == "FX3U"; });
  plc.silent = true;
  steps_until([&] { return newest[0].state == State::offline; });
  plc.silent = false;
  plc.set(kD8101, word(24310));  // the PLC was replaced by an FX2N
  steps_until([&] { return newest[0].model == "FX2N" && newest[0].state != State::offline; });
}

// ---- Modbus TCP: refusals with reasons ----------------------------------------------------------

/// A working Modbus TCP device: only holding registers, with holes chosen by the test. Written from
/// the specification alone (V1.1b3, 6.3 and 6.6).
class FakeModbus final {
 public:
  std::map<unsigned, unsigned> registers;
  std::set<unsigned> lacks;
  unsigned longest = 125;
  std::map<unsigned, std::uint8_t> refuses;  ///< unit → exception for every request
  std::vector<std::string> asked;            ///< "1 read 10 2"

  Bytes answer(ByteView request) {
    if (request.size() < 12) return {};
    const unsigned unit = request[6];
    const unsigned function = request[7];
    const unsigned address = request[8] * 256U + request[9];
    const unsigned value = request[10] * 256U + request[11];
    const bool reads = function == 3;
    asked.push_back(std::to_string(unit) + (reads ? " read " : " write ") +
                    std::to_string(address) + " " + std::to_string(value));
    if (const auto refused = refuses.find(unit); refused != refuses.end())
      return exception(request, refused->second);
    if (!reads) {
      registers[address] = value;
      return framed(request, Bytes(request.begin() + 7, request.begin() + 12));
    }
    const auto hole = lacks.lower_bound(address);
    if (value > longest || (hole != lacks.end() && *hole < address + value))
      return exception(request, 2);
    Bytes pdu{3, static_cast<std::uint8_t>(2 * value)};
    for (unsigned i = 0; i < value; ++i) {
      pdu.push_back(static_cast<std::uint8_t>(registers[address + i] >> 8));
      pdu.push_back(static_cast<std::uint8_t>(registers[address + i]));
    }
    return framed(request, pdu);
  }

 private:
  static Bytes exception(ByteView request, std::uint8_t code) {
    return framed(request, {static_cast<std::uint8_t>(request[7] | 0x80), code});
  }
  static Bytes framed(ByteView request, const Bytes& pdu) {
    Bytes frame{request[0], request[1], 0, 0, 0, static_cast<std::uint8_t>(pdu.size() + 1),
                request[6]};
    frame.insert(frame.end(), pdu.begin(), pdu.end());
    return frame;
  }
};

/// One TCP connection with units behind it.
struct ModbusPolls : PollerTest {
  ModbusPolls() { config.links.push_back({"gw", TcpSettings{"127.0.0.1", 502}, nanoseconds(0)}); }
  DeviceConfig& add_unit(std::int64_t unit, milliseconds interval = milliseconds(0)) {
    config.devices.push_back(device_on("modbus-tcp", codec_of("modbus-tcp", {{"unit", unit}}),
                                       "unit" + std::to_string(unit)));
    config.devices.back().groups[0].interval = interval;
    return config.devices.back();
  }
  Bytes answer(ByteView request) override { return peer.answer(request); }

  FakeModbus peer;
};

TEST_F(ModbusPolls, BlockWithAHoleIsCutUntilEverythingElseIsRead) {
  DeviceConfig& meter = add_unit(1);
  for (int n = 0; n < 32; ++n)
    meter.tags.push_back(tag(*meter.codec, "r" + std::to_string(n), "hr:" + std::to_string(n)));
  peer.lacks = {11};
  start();
  steps_until([&] { return telemetry.size() > 10; });
  for (const Telemetry& message : telemetry) EXPECT_EQ(bad(message), 1U);
  const Telemetry& settled = telemetry.back();
  EXPECT_EQ(settled.readings[11].bad, BadReason::nak);
  EXPECT_EQ(newest[0].state, State::degraded);
  // From here on there are two reads, and neither touches the hole.
  const std::size_t before = peer.asked.size();
  steps_until([&] { return peer.asked.size() >= before + 6; });
  for (std::size_t i = before; i < peer.asked.size(); ++i)
    EXPECT_TRUE(peer.asked[i] == "1 read 0 11" || peer.asked[i] == "1 read 12 20") << peer.asked[i];
}

TEST_F(ModbusPolls, HoleInAValueOfTwoRegistersIsLoggedWithBoth) {
  DeviceConfig& meter = add_unit(1);
  meter.tags.push_back(tag(*meter.codec, "energy", "hr:10", DataType::uint32));
  peer.lacks = {11};
  testing::internal::CaptureStderr();
  start();
  steps_until([&] { return !telemetry.empty(); });
  expect_says(testing::internal::GetCapturedStderr(), "refused=\"hr:10 to hr:11\"");
}

TEST_F(ModbusPolls, DeviceThatGivesFewRegistersAtOnceIsReadInSmallerBlocks) {
  DeviceConfig& meter = add_unit(1);
  for (int n = 0; n < 100; ++n)
    meter.tags.push_back(tag(*meter.codec, "r" + std::to_string(n), "hr:" + std::to_string(n)));
  peer.longest = 30;
  start();
  steps_until([&] { return telemetry.size() > 3; });
  for (const Telemetry& message : telemetry) EXPECT_EQ(bad(message), 0U);
  EXPECT_EQ(newest[0].state, State::online);
}

TEST_F(ModbusPolls, UnitThatItsGatewayDoesNotReachIsOfflineAndTheConnectionStays) {
  for (const std::int64_t unit : {1, 2}) {
    DeviceConfig& meter = add_unit(unit, milliseconds(10));
    meter.timeout = milliseconds(50);
    meter.tags.push_back(tag(*meter.codec, "r", "hr:0"));
  }
  peer.refuses[2] = 0x0B;
  start();
  steps_until([&] { return newest[1].state == State::offline && newest[1].reason == "timeout"; });
  const std::size_t seen = telemetry.size();
  steps_until([&] { return telemetry.size() > seen + 20; });
  EXPECT_EQ(newest[0].state, State::online);
  EXPECT_EQ(wire->opened(), 1U);
  const auto asked_2 = std::count(peer.asked.begin(), peer.asked.end(), "2 read 0 1");
  const auto asked_1 = std::count(peer.asked.begin(), peer.asked.end(), "1 read 0 1");
  EXPECT_LT(asked_2 * 2, asked_1) << "a unit that is not there is left alone for a while";
  peer.refuses.clear();
  steps_until([&] { return newest[1].state == State::online; });
}

TEST_F(ModbusPolls, BusyUnitIsAskedAgainInTheSameCycle) {
  DeviceConfig& meter = add_unit(1, hours(1));
  meter.tags.push_back(tag(*meter.codec, "r", "hr:0"));
  peer.refuses[1] = 0x06;
  start();
  steps_until([&] { return peer.asked.size() == 2; });
  peer.refuses.clear();
  steps_until([&] { return !telemetry.empty(); });
  EXPECT_EQ(bad(telemetry.front()), 0U);
  EXPECT_EQ(peer.asked.size(), 3U);
}

TEST_F(ModbusPolls, BusyUnitIsLeftAloneForAMoment) {
  DeviceConfig& meter = add_unit(1, hours(1));
  meter.tags.push_back(tag(*meter.codec, "r", "hr:0"));
  peer.refuses[1] = 0x06;
  start();
  steps_until([&] { return peer.asked.size() == 1; });
  const PollScheduler::Job job = scheduler.next(now);
  ASSERT_EQ(job.kind, PollScheduler::Job::Kind::wait);
  EXPECT_GE(job.until - now, milliseconds(90)) << "it says itself that it has no time";
}

TEST_F(ModbusPolls, UnitWithoutTagsIsAskedWhetherItIsThere) {
  add_unit(1).retries = 0;
  peer.lacks = {0};  // a refusal is an answer
  start();
  poller->add_question(*devices[0]);
  steps_until([&] { return newest[0].state == State::online; });
  EXPECT_EQ(peer.asked, std::vector<std::string>{"1 read 0 1"});
  EXPECT_EQ(newest[0].run, std::nullopt);
  EXPECT_TRUE(telemetry.empty());
  const auto asked_at = now;
  step();
  EXPECT_GE(now - asked_at, std::chrono::seconds(9)) << "every 10 s";
  EXPECT_EQ(peer.asked.size(), 2U);
  peer.refuses[1] = 0x0B;  // from its gateway
  steps_until([&] { return newest[0].state == State::offline; });
  EXPECT_EQ(newest[0].reason, "timeout");
}

TEST_F(ModbusPolls, QuestionWhetherAUnitIsThereIsPartOfTheLongestPollAndTheLoad) {
  config.links[0].char_time = std::chrono::microseconds(1042);
  add_unit(1);
  start();
  poller->add_question(*devices[0]);
  EXPECT_GT(poller->longest_poll(), milliseconds(0));
  steps_until([&] { return newest[0].state == State::online; });
  EXPECT_GT(scheduler.load(), 0.0);
}

TEST_F(ModbusPolls, LongestPollIsThatOfTheSlowestPlan) {
  config.links[0].char_time = std::chrono::microseconds(1042);
  DeviceConfig& one = add_unit(1, hours(1));
  one.tags.push_back(tag(*one.codec, "r", "hr:0"));
  DeviceConfig& many = add_unit(2, hours(1));
  for (int n = 0; n < 100; ++n)
    many.tags.push_back(tag(*many.codec, "r" + std::to_string(n), "hr:" + std::to_string(n)));
  start();
  const Plan& plan = devices[1]->groups[0]->cycle.reads().plan();
  ASSERT_EQ(plan.reads.size(), 1U);
  EXPECT_EQ(poller->longest_poll(), plan.line_time);
}

// ---- a peer that answers everything with nonsense -----------------------------------------------

struct StrangerPolls : PollerTest {
  Bytes answer(ByteView) override { return Bytes(20, 0xFF); }
  /// Adds a device with these options of `mc-3e`.
  DeviceConfig& add(Options options) {
    config.links.push_back({"net", TcpSettings{"192.0.2.10", 5007}, nanoseconds(0)});
    DeviceConfig& device = config.devices.emplace_back();
    device = device_on("mc-3e", codec_of("mc-3e", std::move(options)));
    device.groups[0].interval = milliseconds(5);
    device.tags.push_back(tag(*device.codec, "temp", "D100"));
    return device;
  }
  void step_on_open_bus() {
    if (!bus->is_open()) run_on(io, bus->open());
    step();
  }
  /// Expects that such a device rests after three polls.
  void expect_rest(Options options) {
    add(std::move(options));
    start();
    SteadyTime began;
    for (began = Clock::now(); telemetry.size() < 3; began = Clock::now()) {
      EXPECT_LT(scheduler.next(began).until, began + milliseconds(1000));
      step_on_open_bus();
    }
    EXPECT_GE(scheduler.next(began).until, began + milliseconds(900));
  }
};

TEST_F(StrangerPolls, ItsPollsRest) { expect_rest({{"model", std::string("FX5U")}}); }
TEST_F(StrangerPolls, ItsPollsRestIfItIsAskedForItsModel) { expect_rest({}); }

TEST_F(StrangerPolls, ARestDoesNotPutOffASampleBeyondMaxSilent) {
  GroupConfig& group = add({{"model", std::string("FX5U")}}).groups[0];
  group.on_change = true;
  group.max_silent = std::chrono::minutes(10);
  start();
  scheduler.device(devices[0]->id).set_back_off({hours(1), hours(1)});
  for (int i = 0; i < 100 && devices[0]->collected < 3; ++i) step_on_open_bus();
  EXPECT_EQ(telemetry.size(), 2U) << "the change, and the last one before the rest";
}

}  // namespace
}  // namespace fxagent::test
