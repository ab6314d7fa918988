#include "agent/field/link/link_state.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "protocol/catalog.h"
#include "tests/agent/field/field_plant.h"
#include "tests/agent/field/port_frames.h"
#include "tests/agent/field/scripted_bus.h"
#include "tests/support/says.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;
using State = DeviceStatus::State;

/// One link with one device that is silent after three unanswered exchanges.
struct LinkStateTest : ScriptedBusTest {
  void use(decltype(LinkConfig::channel) channel) {
    config.links.push_back({"line1", std::move(channel), nanoseconds(0)});
    config.devices.push_back(port_device());
    hinting = *config.devices[0].protocol;
    hinting.hints.silent = "is it switched on";
    hinting.hints.closed = "is another program using this connection?";
    config.devices[0].protocol = &hinting;
    const bool udp = std::holds_alternative<UdpSettings>(config.links[0].channel);
    make_bus({}, {}, udp ? std::optional(ScriptedTransport::Port::renewed) : std::nullopt);
    devices.push_back(std::make_unique<LinkDevice>(config.devices.shared(0), 0));
    devices[0]->id = scheduler.add_device(3, {});
    devices[0]->station.wiring = wiring_of(config.links[0], config.devices[0]);
    const LinkParts parts{config.links[0], 0, *bus, scheduler, devices, outbox};
    link = std::make_unique<LinkState>(parts, 1);
  }
  void open() {
    ScriptedBusTest::open();
    link->opened();
  }
  /// Returns the device states reported since the last call.
  std::vector<DeviceStatus> told() { return outbox.take().states; }
  nanoseconds next_open_in() const { return link->next_open() - Clock::now(); }

  /// Returns the log output of `action`.
  static std::string logged(const std::function<void()>& action) {
    testing::internal::CaptureStderr();
    action();
    return testing::internal::GetCapturedStderr();
  }
  /// Opens the link as the worker does, and sends a request if that makes sense.
  void try_it(Bytes answer = {}) {
    if (!answer.empty()) wire->expect(kReadD100).give(std::move(answer));
    const auto opened = run_on(io, bus->open());
    if (!opened) return link->open_failed(opened.error().text);
    link->opened();
    Station& press = devices[0]->station;
    press.enquire = EnquirePolicy::never;
    const Request d100{Read{press.codec->addresses().parse_address("D100", {})->span}};
    const Exchange exchange = run_on(io, bus->exchange(press, d100));
    if (exchange.has_answer()) link->answered(*devices[0]);
    if (exchange.outcome == Exchange::Outcome::link_down) link->lost(exchange.error);
  }

  void add_neighbour() {
    config.devices.push_back(port_device("press2"));
    devices.push_back(std::make_unique<LinkDevice>(config.devices.shared(1), 1));
    devices[1]->id = scheduler.add_device(3, {});
  }

  const Bytes kReadD100 = read_frame(kD100, 2);
  ProtocolInfo hinting;
  Config config;
  Outbox outbox{1000};
  PollScheduler scheduler;
  LinkDevices devices;
  std::unique_ptr<LinkState> link;
};

struct LinkStateOnSerial : LinkStateTest {
  LinkStateOnSerial() { use(SerialSettings{}); }
};

TEST_F(LinkStateOnSerial, LinkThatIsAloneOpensAtOnce) {
  const auto now = Clock::now();
  EXPECT_GE(link->begin(now, milliseconds(1000)), nanoseconds(0));
  EXPECT_LE(link->next_open() - now, milliseconds(20));
}

TEST_F(LinkStateOnSerial, LossMakesEveryDeviceOfflineAndIsToldOnce) {
  open();
  link->answered(*devices[0]);
  link->update(*devices[0]);
  EXPECT_EQ(told().at(0).state, State::online);
  bus->close();
  link->check_bus();
  const auto states = told();
  ASSERT_EQ(states.size(), 1U);
  EXPECT_EQ(states[0].state, State::offline);
  EXPECT_EQ(states[0].reason, "link_down");
  link->check_bus();
  EXPECT_TRUE(told().empty());
}

TEST_F(LinkStateOnSerial, SerialLineThatWasLostIsOpenedAtOnceAndThenEachTimeLater) {
  open();
  bus->close();
  link->check_bus();
  EXPECT_LE(next_open_in(), nanoseconds(0));
  link->open_failed("no such device");
  const nanoseconds first = next_open_in();
  EXPECT_GT(first, milliseconds(300));
  EXPECT_LE(first, milliseconds(600));
  link->open_failed("no such device");
  EXPECT_GT(next_open_in(), milliseconds(700));
  open();
  bus->close();
  link->check_bus();
  link->open_failed("no such device");
  EXPECT_LE(next_open_in(), milliseconds(600)) << "it was open, so this failure is a first one";
}

TEST_F(LinkStateOnSerial, GarbageIsToldOnceForEachDeviceAndCauseWithItsFirstBytes) {
  const auto told_of = [&](const Bytes& received) {
    Exchange exchange;
    exchange.outcome = Exchange::Outcome::garbled;
    exchange.error = "no STX";
    exchange.received = received;
    devices[0]->unexpected_bytes_from = {};  // a while has passed
    testing::internal::CaptureStderr();
    devices[0]->log_foreign_bytes(exchange);
    return testing::internal::GetCapturedStderr();
  };
  // STX and digits with 7 bits and even parity.
  const Bytes parity{0x82, 0x33, 0xB4, 0xB1, 0xB2, 0xC3, 0x44, 0x41, 0x42,
                     0x03, 0x44, 0xB7, 0x82, 0x33, 0xB4, 0xB1, 0xB2, 0xC3};
  const std::string first = told_of(parity);
  expect_says(first,
              "warning device device=press1 heard=\"82 33 B4 B1 B2 C3 44 41 42 03 44 B7 82 "
              "33 B4 B1 … (18 bytes)\" reason=\"no STX\" looks_like=\"7 bits with even "
              "parity in bit 7: ");
  EXPECT_EQ(told_of(parity), "") << "the same cause";
  EXPECT_NE(told_of({0xFF, 0x00, 0x13, 0x99}), "");
  EXPECT_EQ(told_of({}), "") << "silence is no garbage";
  devices[0]->causes_logged_since = Clock::now() - std::chrono::hours(24);
  EXPECT_NE(told_of(parity), "") << "a day later it is news again";
}

TEST_F(LinkStateOnSerial, GarbageIsLookedAtOnceInAWhile) {
  Exchange exchange;
  exchange.received = {0x82, 0x33, 0xB4, 0xB1};
  testing::internal::CaptureStderr();
  devices[0]->log_foreign_bytes(exchange);
  exchange.received = {0xFF, 0x00, 0x13, 0x99};  // another cause, logged at once
  devices[0]->log_foreign_bytes(exchange);
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_EQ(std::ranges::count(log, '\n'), 1) << log;
}

TEST_F(LinkStateOnSerial, LinkThatComesAndGoesIsReadAtOnceNoMoreThanEveryTenSeconds) {
  const auto begin = Clock::now();
  scheduler.add_group(devices[0]->id, std::chrono::minutes(10), 1, begin + std::chrono::hours(1));
  open();
  const auto come_and_go = [&] {
    bus->close();
    link->check_bus();
    open();
    return scheduler.next(Clock::now());
  };
  const PollScheduler::Job back = come_and_go();
  ASSERT_EQ(back.kind, PollScheduler::Job::Kind::poll);
  EXPECT_TRUE(scheduler.step_done(back.poll));
  SteadyTime next{};
  for (int i = 0; i < 5; ++i) {
    const PollScheduler::Job job = come_and_go();
    ASSERT_EQ(job.kind, PollScheduler::Job::Kind::wait);
    EXPECT_LE(job.until - Clock::now(), std::chrono::seconds(10));
    if (i > 0) {
      EXPECT_EQ(job.until, next) << "one is planned, and is not put off";
    }
    next = job.until;
  }
  EXPECT_GE(next - begin, std::chrono::seconds(10));
}

TEST_F(LinkStateTest, TcpPeerThatNeverAnswersIsLeft) {
  use(TcpSettings{"192.0.2.10", 5551});
  open();
  for (int i = 0; i < 2; ++i) link->unanswered(*devices[0]);
  EXPECT_TRUE(bus->is_open());
  link->answered(*devices[0]);
  for (int i = 0; i < 2; ++i) link->unanswered(*devices[0]);
  EXPECT_TRUE(bus->is_open()) << "an answer starts the count anew";
  link->unanswered(*devices[0]);
  EXPECT_FALSE(bus->is_open());
  EXPECT_EQ(told().at(0).reason, "timeout");
}

TEST_F(LinkStateTest, WhereNobodyAnswersTheStateIsToldOnce) {
  use(UdpSettings{"192.0.2.10", 5007, 0});
  open();
  link->answered(*devices[0]);
  link->update(*devices[0]);
  EXPECT_EQ(told().size(), 1U);
  for (int round = 0; round < 5; ++round) {
    for (int i = 0; i < 3 && bus->is_open(); ++i) {
      link->unanswered(*devices[0]);
      link->update(*devices[0]);
    }
    EXPECT_FALSE(bus->is_open());
    open();
    link->update(*devices[0]);
  }
  const auto states = told();
  ASSERT_EQ(states.size(), 1U);
  EXPECT_EQ(states[0].reason, "timeout");
  link->answered(*devices[0]);
  link->update(*devices[0]);
  EXPECT_EQ(told().at(0).state, State::online);
}

TEST_F(LinkStateOnSerial, ModelIsAskedAgainAfterALoss) {
  config.devices[0].codec = port_codec(fx::Model::unknown_fx);
  devices[0] = std::make_unique<LinkDevice>(config.devices.shared(0), 0);
  devices[0]->id = 0;
  open();
  devices[0]->state.set_model("FX3U");
  bus->close();
  link->check_bus();
  EXPECT_FALSE(devices[0]->state.is_model_known());
}

TEST_F(LinkStateTest, PeerThatClosesBeforeItsFirstAnswerIsTriedEverMoreSeldomAndToldOnce) {
  use(TcpSettings{"192.0.2.10", 5551});
  for (int i = 0; i < 2; ++i) wire->hang_up();  // during the drain
  for (int i = 0; i < 3; ++i) wire->silence().expect(kReadD100).hang_up();
  std::string log;
  nanoseconds before{0};
  for (int i = 0; i < 5; ++i) {
    log += logged([&] { try_it(); });
    EXPECT_FALSE(bus->is_open());
    const nanoseconds wait = next_open_in();
    EXPECT_GT(wait, std::max<nanoseconds>(milliseconds(700), before)) << "attempt " << i;
    before = wait;
  }
  EXPECT_GT(before, std::chrono::seconds(10));
  const std::string_view told =
      "reason=\"the scripted peer has gone before its first answer\" note=\"is another program "
      "using this connection?\"";
  ASSERT_NE(log.find(told), std::string::npos) << log;
  EXPECT_EQ(log.find(told), log.rfind(told)) << log;
  EXPECT_EQ(log.find("state=up"), std::string::npos) << log;
}

TEST_F(LinkStateTest, ConnectionThatFollowsAVainOneIsUpOnceItHasAnswered) {
  use(TcpSettings{"192.0.2.10", 5551});
  wire->silence().expect(kReadD100).hang_up();
  EXPECT_NE(logged([&] { try_it(); }).find("state=up"), std::string::npos)
      << "nothing is known yet";
  wire->silence();
  const std::string log = logged([&] { try_it(word_frame(1)); });
  expect_says(log, "state=up");
  EXPECT_TRUE(bus->is_open());
  bus->close();
  link->check_bus();
  EXPECT_LE(next_open_in(), milliseconds(200)) << "it had answered";
  link->open_failed("refused");
  EXPECT_LE(next_open_in(), milliseconds(600)) << "the first failure";
}

TEST_F(LinkStateTest, BroadcastLinkIsUpWithoutAnAnswer) {
  use(TcpSettings{"192.0.2.10", 5551});
  devices[0]->codec = codec_of("modbus-rtu", {{"unit", std::int64_t{0}}});
  wire->hang_up();
  try_it();
  EXPECT_LE(next_open_in(), milliseconds(600));
}

TEST_F(LinkStateTest, ConnectionOverWhichNothingWasEverAnsweredIsToldWithWhatToLookAt) {
  use(TcpSettings{"192.0.2.10", 5551});
  std::string log;
  for (int session = 0; session < 3; ++session) {
    open();
    log += logged([&] {
      for (int i = 0; i < 3; ++i) link->unanswered(*devices[0]);
    });
    EXPECT_LE(next_open_in(), milliseconds(200)) << "it was not the peer who closed it";
  }
  expect_says(log, "reason=\"no answers on this connection\"");
  EXPECT_EQ(log.find("no answers on"), log.rfind("no answers on")) << log;
  expect_says(log, "is it switched on");
  EXPECT_EQ(log.find("is it switched on"), log.rfind("is it switched on")) << log;
}

TEST_F(LinkStateTest, DeviceThatNeverAnsweredIsOfflineAfterItsFirstTimeoutWithWhatToCheck) {
  use(SerialSettings{"/dev/ttyUSB0"});
  open();
  const std::string log = logged([&] {
    link->unanswered(*devices[0]);
    link->update(*devices[0]);
  });
  expect_says(log,
              "warning device device=press1 state=offline reason=timeout note=\"no answer "
              "on /dev/ttyUSB0. Check: does the device have power; is it switched on; ");
  const auto states = told();
  ASSERT_EQ(states.size(), 1U);
  EXPECT_EQ(states[0].reason, "timeout");
  EXPECT_NE(log.find(states[0].reason_text), std::string::npos) << "one text in log and state";
  link->unanswered(*devices[0]);
  link->update(*devices[0]);
  EXPECT_TRUE(told().empty());
}

TEST_F(LinkStateTest, DeviceThatHasAnsweredIsOfflineAfterAllItsTimeoutsAndHasTheRightSettings) {
  use(SerialSettings{"/dev/ttyUSB0"});
  open();
  link->answered(*devices[0]);
  link->update(*devices[0]);
  told();
  for (int i = 0; i < 2; ++i) {
    link->unanswered(*devices[0]);
    link->update(*devices[0]);
  }
  EXPECT_TRUE(told().empty()) << "it needs three";
  link->unanswered(*devices[0]);
  link->update(*devices[0]);
  const std::string text = told().at(0).reason_text;
  expect_says(text, "it has answered before");
  EXPECT_EQ(text.find("is it switched on"), std::string::npos) << text;
  link->answered(*devices[0]);
  link->update(*devices[0]);
  EXPECT_EQ(told().at(0).reason_text, "");
}

TEST_F(LinkStateTest, DeviceWhoseNeighbourAnswersIsInDoubtAlone) {
  use(SerialSettings{"/dev/ttyUSB0"});
  add_neighbour();
  open();
  link->answered(*devices[1]);
  link->unanswered(*devices[0]);
  link->update(*devices[0]);
  const std::string text = told().at(0).reason_text;
  expect_says(text, "other devices on /dev/ttyUSB0 answer");
}

TEST_F(LinkStateOnSerial, NeighboursOfADeviceThatLeavesAPollUnansweredGoBeforeACommand) {
  add_neighbour();
  scheduler.add_group(devices[1]->id, milliseconds(0), 1, SteadyTime{});
  scheduler.share().command_waits();
  open();
  for (const bool by_gateway : {false, true}) {
    EXPECT_EQ(scheduler.next(Clock::now()).kind, PollScheduler::Job::Kind::command);
    if (by_gateway)
      link->unreachable(*devices[0], "exception 0B", milliseconds(500));
    else
      link->unanswered(*devices[0]);
    const PollScheduler::Job job = scheduler.next(Clock::now());
    ASSERT_EQ(job.kind, PollScheduler::Job::Kind::poll);
    scheduler.step_used(job.poll, std::chrono::hours(1));
    scheduler.step_done(job.poll);
  }
}

TEST_F(LinkStateOnSerial, RefusalByAGatewayGivesOthersNoMoreTimeThanItTook) {
  add_neighbour();
  scheduler.add_group(devices[1]->id, milliseconds(0), 1, SteadyTime{});
  scheduler.share().command_waits();
  link->unreachable(*devices[0], "exception 0B", nanoseconds(0));
  EXPECT_EQ(scheduler.next(Clock::now()).kind, PollScheduler::Job::Kind::command);
}

TEST_F(LinkStateOnSerial, NoDeviceOfADeadLineIsToldThatOthersStillAnswer) {
  add_neighbour();
  open();
  for (const auto& device : devices) {
    link->answered(*device);
    link->update(*device);
  }
  for (int i = 0; i < 9; ++i) link->unanswered(*devices[0]);
  for (int i = 0; i < 3; ++i) {
    link->answered(*devices[1]);
    link->unanswered(*devices[0]);
  }
  for (int i = 0; i < 3; ++i) link->unanswered(*devices[1]);
  told();
  for (const auto& device : devices) link->update(*device);
  for (const DeviceStatus& status : told())
    EXPECT_EQ(status.reason_text.find("still answer"), std::string::npos) << status.reason_text;
}

TEST_F(LinkStateTest, UnitThatFallsSilentAloneBehindAGatewayIsNamedWithItsWire) {
  use(TcpSettings{"192.0.2.10", 502});
  add_neighbour();
  config.devices[0].options = std::make_shared<Options>(Options{{"unit", std::int64_t{5}}});
  devices[0] = std::make_unique<LinkDevice>(config.devices.shared(0), 0);
  devices[0]->station.wiring = wiring_of(config.links[0], config.devices[0]);
  open();
  const auto text_after_silence = [&](bool neighbour_answers) {
    for (const auto& device : devices) link->answered(*device);
    for (const auto& device : devices) link->update(*device);
    for (int i = 0; i < 3; ++i) {
      if (neighbour_answers) link->answered(*devices[1]);
      link->unanswered(*devices[0]);
    }
    link->update(*devices[0]);
    std::string text;
    for (const DeviceStatus& status : told())
      if (status.device == 0) text = status.reason_text;
    return text;
  };
  expect_says(text_after_silence(true),
              "`unit` (5) has answered before, and other devices on 192.0.2.10:502 still answer. "
              "Check: does it have power; is its own wire behind 192.0.2.10:502 in order");
  expect_says(text_after_silence(false), "it has answered before. Check: does it have power");
}

TEST_F(LinkStateTest, LinkThatIsDownSaysWhyInTheStateOfItsDevices) {
  use(TcpSettings{"192.0.2.10", 502});
  const std::string why = "192.0.2.10:502: connection refused";
  const std::string log = logged([&] { link->open_failed(why); });
  expect_says(log, "warning device device=press1 state=offline reason=link_down");
  EXPECT_EQ(told().at(0).reason_text, why);
}

TEST_F(LinkStateTest, UdpLinkIsUpWithItsFirstAnswer) {
  use(UdpSettings{"192.0.2.10", 5007, 0});
  for (int session = 0; session < 2; ++session) {
    std::string log = logged([&] { open(); });
    EXPECT_EQ(log.find("state=up"), std::string::npos) << session << log;
    log = logged([&] {
      for (int i = 0; i < 2; ++i) link->answered(*devices[0]);
    });
    expect_says(log, "state=up");
    EXPECT_EQ(log.find("state=up"), log.rfind("state=up")) << log;
    for (int i = 0; i < 3; ++i) link->unanswered(*devices[0]);
  }
}

TEST_F(LinkStateTest, DeviceOfALinkThatWasNotOpenedYetIsNotOffline) {
  use(TcpSettings{"192.0.2.10", 502});
  EXPECT_EQ(logged([&] { link->update(*devices[0]); }), "");
  EXPECT_TRUE(told().empty());
  link->yielded("until 12:00");
  EXPECT_EQ(told().at(0).state, State::yielded);
  link->taken_back();
  link->update(*devices[0]);
  EXPECT_TRUE(told().empty()) << "it is yielded until the link opens, or fails to";
}

TEST_F(LinkStateTest, UdpPortWhereNobodyAnswersIsLeft) {
  use(UdpSettings{"192.0.2.10", 5007, 0});
  open();
  const std::string log = logged([&] {
    for (int i = 0; i < 3; ++i) link->unanswered(*devices[0]);
  });
  EXPECT_FALSE(bus->is_open());
  expect_says(log, "reason=\"no answers on this UDP port\"");
  EXPECT_EQ(told().at(0).reason, "timeout");
}

TEST_F(LinkStateTest, UdpPortWhereNobodyListensIsTriedEverMoreSeldomAndToldOnce) {
  use(UdpSettings{"192.0.2.10", 5007, 0});
  std::string log;
  for (int i = 0; i < 4; ++i) {
    wire->expect(kReadD100).hang_up();
    log += logged([&] { try_it(); });
  }
  EXPECT_GT(next_open_in(), std::chrono::seconds(5));
  EXPECT_EQ(log.find("state=down"), log.rfind("state=down")) << log;
  EXPECT_EQ(log.find("another program"), std::string::npos) << "UDP has no connections: " << log;
}

TEST_F(LinkStateOnSerial, SerialLineIsNotClosedBySilence) {
  open();
  for (int i = 0; i < 10; ++i) link->unanswered(*devices[0]);
  EXPECT_TRUE(bus->is_open());
  link->update(*devices[0]);
  EXPECT_EQ(told().at(0).reason, "timeout");
}

TEST_F(LinkStateTest, GatewayThatAnswersInPlaceOfItsUnitIsThere) {
  use(TcpSettings{"192.0.2.10", 502});
  open();
  for (int i = 0; i < 10; ++i) link->unreachable(*devices[0], "exception 0B", {});
  EXPECT_TRUE(bus->is_open());
  link->update(*devices[0]);
  const DeviceStatus status = told().at(0);
  EXPECT_EQ(status.reason, "timeout") << "the unit itself is silent";
  EXPECT_EQ(status.reason_text.find("\"exception 0B\": the gateway 192.0.2.10:502 answers"), 0U)
      << status.reason_text;
}

TEST_F(LinkStateOnSerial, StateIsToldOnlyWhereItIsAnotherOne) {
  open();
  link->update(*devices[0]);
  EXPECT_TRUE(told().empty()) << "nothing is known before the first answer";
  link->answered(*devices[0]);
  link->update(*devices[0]);
  link->update(*devices[0]);
  EXPECT_EQ(told().size(), 1U);
}

}  // namespace
}  // namespace fxagent::test
