#include "agent/field/link/link_worker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <asio/co_spawn.hpp>
#include <asio/io_context.hpp>
#include <asio/post.hpp>
#include <iterator>
#include <numeric>

#include "agent/commands/admission.h"
#include "tests/agent/field/fake_port.h"
#include "tests/agent/field/field_plant.h"
#include "tests/agent/field/on_io.h"
#include "tests/agent/field/port_frames.h"
#include "tests/support/says.h"
#include "tests/support/scripted_transport.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;
using State = DeviceStatus::State;

const Bytes kReadD100 = read_frame(kD100, 2);
const Bytes kWrite50 = write_frame(kD200, word(50));

/// One link with its worker, whose output is collected here. After the script, `plc` answers.
struct LinkWorkerTest : ::testing::Test {
  LinkWorkerTest() {
    config.links.push_back({"line1", SerialSettings{}, nanoseconds(0)});
    config.devices.push_back(press());
  }
  ~LinkWorkerTest() override {
    if (worker != nullptr) stop();
  }

  /// temp (D100, read) and setpoint (D200, read/write) in a group without an interval.
  static DeviceConfig press(std::string name = "press1",
                            std::shared_ptr<const Codec> codec = port_codec()) {
    DeviceConfig device = port_device(std::move(name), std::move(codec));
    device.tags.push_back(tag(*device.codec, "temp", "D100"));
    device.groups.push_back(group("slow", milliseconds(0)));
    return device;
  }
  /// Adds a tag to the polled group.
  void add_tag(std::string name, std::string_view address) {
    DeviceConfig& device = config.devices[0];
    device.tags.push_back(tag(*device.codec, std::move(name), address));
  }
  void add_setpoint(std::string_view address = "D200") {
    add_tag("setpoint", address);
    config.devices[0].tags.back().writable = true;
  }

  /// Creates the transport for scripting; the worker starts with start().
  ScriptedTransport& script() {
    if (!transport) {
      transport = std::make_unique<ScriptedTransport>(io.get_executor());
      wire = transport.get();
      wire->then([this](ByteView request) { return plc.answer(request); });
    }
    return *wire;
  }
  void start(Polling polling = Polling::on) {
    script();
    worker = std::make_unique<LinkWorker>(io.get_executor(), config, 0, devices_by_link(config)[0],
                                          outbox, std::move(transport),
                                          std::vector<std::uint64_t>(8, 100), polling);
    for (Command& command : interrupted) submit_interrupted(std::move(command));
    asio::co_spawn(io, worker->run(), [this](std::exception_ptr bug) {
      ended = true;
      if (bug) std::rethrow_exception(bug);
    });
  }
  /// Like the uplink: an admitted command goes to the worker, a refused one is answered directly.
  void submit(Command command) {
    auto decision =
        admission(command.device).admit(std::move(command), codec(command.device), 0, Clock::now());
    if (auto* result = std::get_if<CommandResult>(&decision))
      outbox.push(std::move(*result));
    else
      worker->submit(std::move(std::get<AdmittedCommand>(decision)));
  }
  void submit_interrupted(Command command) {
    auto admitted =
        admission(command.device).interrupted(command, codec(command.device), Clock::now());
    ASSERT_TRUE(admitted) << "there is nothing to be read";
    worker->submit(std::move(*admitted));
  }
  CommandAdmission& admission(std::uint32_t device) {
    return admissions.try_emplace(device, config.devices[device]).first->second;
  }
  std::shared_ptr<const Codec> codec(std::uint32_t device) const {
    const auto found = codecs.find(device);
    return found == codecs.end() ? config.devices[device].codec : found->second;
  }
  void stop() {
    worker->stop();
    run_until(io, [this] { return ended; });
    collect();
    EXPECT_EQ(wire->steps_left(), 0U) << "the script was not played out";
  }
  void collect() {
    Outbox::Batch batch = outbox.take();
    for (auto& message : batch.telemetry) telemetry.push_back(std::move(message));
    for (auto& status : batch.states) {
      codecs[status.device] = status.codec;
      states.push_back(std::move(status));
    }
    for (auto& result : batch.results) {
      if (result.status != CommandStatus::duplicate) admission(result.device).finished(result);
      results.push_back(std::move(result));
    }
  }
  void wait(const std::function<bool()>& reached) {
    run_until(io, [&] {
      collect();
      return reached();
    });
  }
  /// Returns when others have had their turn on the thread.
  void wait_for_the_thread() {
    bool had_their_turn = false;
    asio::post(io, [&] { had_their_turn = true; });
    wait([&] { return had_their_turn; });
  }
  /// Runs the worker for this many further requests.
  void wait_for_requests(std::size_t more) {
    const std::size_t enough = wire->written().size() + more;
    wait([&] { return wire->written().size() >= enough; });
  }

  Command write_setpoint(std::string id, std::int64_t value = 50, std::uint32_t device = 0) {
    Command command =
        command_of(std::move(id), Op::write, {{"setpoint", "", std::nullopt, number(value)}});
    command.device = device;
    command.verify = false;
    command.received = Clock::now();
    command.received_ms = utc_ms(std::chrono::system_clock::now());
    return command;
  }
  /// Starts a list that writes 50 … 57 to x0 … x7; D200 and its neighbours are tags x0 … x9. Calls
  /// `then` when `writes` of them are on the wire.
  void start_list(std::function<void()> then, int writes) {
    for (int i = 0; i < 10; ++i)
      config.devices[0].tags.push_back(
          writable(tag(*config.devices[0].codec, "x" + std::to_string(i),
                       "D" + std::to_string(200 + i), {}, 1)));
    Command list = write_setpoint("list");
    list.is_list = true;
    list.targets.clear();
    for (int i = 0; i < 8; ++i)
      list.targets.push_back({"x" + std::to_string(i), "", std::nullopt, number(50 + i)});
    script();
    wire->then([this, then = std::move(then), writes](ByteView request) {
      const Bytes answer = plc.answer(request);
      if (plc.asked().back() == write_of(writes - 1)) then();
      return answer;
    });
    start();
    wait([&] { return !telemetry.empty(); });
    submit(list);
  }
  /// The PLC's record of the write to x`i`.
  static std::string write_of(int i) {
    const unsigned place = kD200 + 2 * static_cast<unsigned>(i);
    return "write " + hex_text(place, 4) + " " + hex_of(word(50U + static_cast<unsigned>(i)));
  }
  Command write_tag(std::string id, std::string tag, std::optional<std::int64_t> value = {}) {
    Command command = write_setpoint(std::move(id), value.value_or(50 + (tag.back() - '0')));
    command.targets[0].tag = std::move(tag);
    return command;
  }
  void answer_twice_if(const bool& twice) {
    script().then([this, &twice](ByteView request) {
      const Bytes answer = plc.answer(request);
      return twice && request.size() > 1 ? joined(answer, answer) : answer;
    });
  }
  const CommandResult* result_of(const std::string& id) const {
    const CommandResult* found = nullptr;
    for (const CommandResult& result : results) {
      if (result.id != id) continue;
      EXPECT_EQ(found, nullptr) << "two results for " << id;
      found = &result;
    }
    return found;
  }
  /// How a command ended; empty: it has no result.
  std::string ending_of(const std::string& id) const {
    const CommandResult* result = result_of(id);
    return result == nullptr ? "" : ending(*result);
  }
  const CommandResult& wait_for_result(const std::string& id) {
    wait([&] { return result_of(id) != nullptr; });
    const CommandResult* found = result_of(id);
    static const CommandResult nothing;
    return found != nullptr ? *found : nothing;
  }
  FieldHealth reported() const {
    FieldHealth health;
    health.links.resize(1);
    health.devices.resize(config.devices.size());
    health.durations.resize(config.http ? 1 : 0);
    worker->report(health);
    return health;
  }
  /// Returns the newest state of a device.
  DeviceStatus state(std::uint32_t device = 0) const {
    DeviceStatus newest;
    for (const DeviceStatus& status : states)
      if (status.device == device) newest = status;
    return newest;
  }
  void wait_for_state(State wanted, const std::string& reason, std::uint32_t device = 0) {
    wait([&] { return state(device).state == wanted && state(device).reason == reason; });
  }
  /// Starts on a channel that floods twice, and waits until the third connection is online.
  void expect_two_pauses() {
    const auto began = Clock::now();
    start();
    wait_for_state(State::offline, "never_silent");
    wait_for_state(State::online, "");
    EXPECT_EQ(wire->opened(), 3U);
    // Half a second and then one second, each shortened by at most a fifth.
    EXPECT_GE(Clock::now() - began, milliseconds(1200));
  }
  std::vector<Telemetry> of_device(std::uint32_t device) const {
    std::vector<Telemetry> out;
    for (const Telemetry& message : telemetry)
      if (message.device == device) out.push_back(message);
    return out;
  }

  asio::io_context io;
  Config config;
  Outbox outbox{100000};
  FakePort plc;
  std::unique_ptr<ScriptedTransport> transport;
  ScriptedTransport* wire = nullptr;
  std::unique_ptr<LinkWorker> worker;
  bool ended = false;
  std::vector<Telemetry> telemetry;
  std::vector<DeviceStatus> states;
  std::vector<CommandResult> results;
  std::vector<Command> interrupted;
  std::map<std::uint32_t, CommandAdmission> admissions;
  std::map<std::uint32_t, std::shared_ptr<const Codec>> codecs;
};

// ---- polls -------------------------------------------------------------------------------------

TEST_F(LinkWorkerTest, PollBecomesATelemetryMessage) {
  plc.set(kD100, word(234));
  start();
  wait([&] { return telemetry.size() >= 3; });
  for (std::size_t i = 0; i < 3; ++i) {
    const Telemetry& message = telemetry[i];
    EXPECT_EQ(message.seq, 101 + i) << "the first after the number given";
    EXPECT_EQ(message.group, 0U);
    EXPECT_GT(message.ts_ms, 0);
    EXPECT_FALSE(message.span_ms) << "one exchange has no span";
    EXPECT_FALSE(message.partial);
    ASSERT_EQ(message.readings.size(), 1U);
    EXPECT_EQ(message.readings[0].value, number(234));
  }
}

TEST_F(LinkWorkerTest, DeviceThatAnswersIsOnline) {
  plc.set(kM8000, {0x01});
  config.devices[0].groups[0].interval = milliseconds(10);
  start();
  wait([&] { return state().state == State::online && state().run.has_value(); });
  EXPECT_TRUE(state().reason.empty());
  EXPECT_EQ(state().model, "FX3U");
  EXPECT_EQ(state().run, true);
  EXPECT_GT(state().since_ms, 0);
}

TEST_F(LinkWorkerTest, CommandGoesBetweenTheRepeatsOfARead) {
  add_setpoint("D2000");  // needs a separate read
  script().expect(kEnq).give(kAck);
  const Bytes write = port_frame("E10" + hex_text(0x4000 + 4000, 4) + "023200");
  wire->expect(kReadD100).call([&] { submit(write_setpoint("b7e1")); });
  wire->give(kNak).expect(write).give(kAck).expect(kReadD100).give(word_frame(7));
  start();
  EXPECT_EQ(wait_for_result("b7e1").status, CommandStatus::succeeded);
  wait([&] { return wire->steps_left() == 0; });
}

TEST_F(LinkWorkerTest, BadTagDoesNotTakeItsNeighboursAlong) {
  add_tag("running", "M0");
  script().then([&](ByteView request) {
    const Bytes asked(request.begin(), request.end());
    return asked == kReadD100 ? kNak : plc.answer(request);
  });
  start();
  wait_for_state(State::degraded, "nak");
  const Telemetry& message = telemetry.at(0);
  EXPECT_EQ(message.readings[0].bad, BadReason::nak);
  EXPECT_FALSE(message.readings[1].bad);
}

TEST_F(LinkWorkerTest, OnChangeIsSuppressedAndCounted) {
  config.devices[0].groups[0].on_change = true;
  plc.set(kD100, word(1));
  start();
  wait([&] { return plc.count("read 10C8 2") >= 20; });
  EXPECT_EQ(telemetry.size(), 1U);
  plc.set(kD100, word(2));
  wait([&] { return telemetry.size() >= 2; });
  EXPECT_EQ(telemetry[1].seq, telemetry[0].seq + 1) << "what was suppressed took no number";
  const FieldHealth health = reported();
  EXPECT_EQ(health.devices[0].collected, health.devices[0].suppressed + 2);
  EXPECT_GE(health.devices[0].polls, 20U);
  EXPECT_GE(health.links[0].exchanges, 20U);
  EXPECT_EQ(health.links[0].timeouts, 0U);
  EXPECT_GT(health.links[0].busy_percent, 0.0);
}

std::uint64_t total(const DurationHistogram& histogram) {
  return std::accumulate(histogram.counts().begin(), histogram.counts().end(), std::uint64_t{0});
}

TEST_F(LinkWorkerTest, DurationsAreCountedWhereTheConfigAsksForMetrics) {
  config.http.emplace();
  start();
  wait([&] { return plc.count("read 10C8 2") >= 20; });
  const FieldHealth health = reported();
  EXPECT_TRUE(health.links[0].open);
  const std::uint64_t answered = total(health.durations[0].turnaround);
  EXPECT_LE(answered, health.links[0].exchanges);
  EXPECT_GE(answered + 1, health.links[0].exchanges) << "one may be on the wire";
  EXPECT_GE(total(health.durations[0].lateness), 20U);
}

// ---- silence, and links that are down ----------------------------------------------------------

TEST_F(LinkWorkerTest, SilentDeviceIsToldOnceAndIsOffline) {
  plc.silent = true;
  config.devices[0].groups[0].interval = milliseconds(5);
  start();
  wait_for_state(State::offline, "timeout");
  const std::size_t attempts = plc.asked().size();
  EXPECT_EQ(attempts, 1U) << "it has never answered";
  wait([&] { return plc.asked().size() > attempts; });
  EXPECT_EQ(telemetry.size(), 1U) << "one message when it turned bad";
  EXPECT_EQ(telemetry[0].readings[0].bad, BadReason::timeout);
  EXPECT_TRUE(telemetry[0].readings[0].value.items.empty());
  plc.silent = false;
  wait_for_state(State::online, "");
  EXPECT_FALSE(telemetry.back().readings[0].bad);
}

TEST_F(LinkWorkerTest, SilentDeviceDoesNotStarveItsNeighbour) {
  config.devices.push_back(port_device("press2"));
  config.devices[1].tags.push_back(tag(*config.devices[1].codec, "level", "D200"));
  for (DeviceConfig& device : config.devices) device.groups[0].interval = milliseconds(2);
  std::size_t vain = 0;
  script().then([&](ByteView request) {
    const Bytes asked(request.begin(), request.end());
    if (asked != kReadD100) return plc.answer(request);
    ++vain;
    return Bytes{};
  });
  const auto began = Clock::now();
  start();
  wait_for_state(State::offline, "timeout", 0);
  const std::size_t before = of_device(1).size();
  wait([&] { return of_device(1).size() >= before + 100; });
  // One answer to the RUN request restarts the count of three. On a machine that stalled, a rest of
  // a second or more may have ended, and the count has restarted again.
  const auto rests = static_cast<std::size_t>((Clock::now() - began) / std::chrono::seconds(1));
  EXPECT_LE(vain, 5 + 3 * rests) << "it rests while its neighbour is asked a hundred times";
  EXPECT_EQ(state(1).state, State::online);
  for (const Telemetry& message : of_device(1)) EXPECT_FALSE(message.readings[0].bad);
}

struct LinkWorkerWithSetpoint : LinkWorkerTest {
  LinkWorkerWithSetpoint() { add_setpoint(); }
  /// Adds a device that is polled without pause. The first is polled every hour.
  void add_neighbour() {
    config.devices[0].groups[0].interval = std::chrono::hours(1);
    config.devices.push_back(port_device("press2"));
    DeviceConfig& neighbour = config.devices[1];
    neighbour.groups[0].interval = milliseconds(0);
    neighbour.tags.push_back(tag(*neighbour.codec, "level", "D210"));
  }
};

TEST_F(LinkWorkerWithSetpoint, CommandToASilentDeviceGoesOutAndFailsAtItsEnquiry) {
  plc.silent = true;
  start();
  wait_for_state(State::offline, "timeout");
  submit(write_setpoint("b7e1"));
  const CommandResult& result = wait_for_result("b7e1");
  EXPECT_EQ(ending(result), "FAILED device_offline");
}

TEST_F(LinkWorkerWithSetpoint, NeighbourIsPolledBetweenTheTriesOfCommandsToASilentDevice) {
  add_neighbour();
  std::vector<std::size_t> polled;  // samples of the neighbour before each try
  script().then([&](ByteView request) {
    const Bytes asked(request.begin(), request.end());
    if (asked != kWrite50 && asked != read_frame(kD200, 2)) return plc.answer(request);
    collect();
    polled.push_back(of_device(1).size());
    return Bytes{};
  });
  start();
  wait([&] { return !of_device(1).empty(); });
  submit(write_setpoint("first"));
  submit(write_setpoint("second"));
  wait_for_result("first");
  submit(write_setpoint("third"));
  for (const char* id : {"second", "third"})
    EXPECT_EQ(ending(wait_for_result(id)), "UNKNOWN_OUTCOME timeout");
  ASSERT_EQ(polled.size(), 6U) << "each write and its read-back";
  for (std::size_t i = 1; i < polled.size(); ++i) EXPECT_GT(polled[i], polled[i - 1]) << i;
}

TEST_F(LinkWorkerWithSetpoint, StopDuringThePollsBeforeAReadBackLeavesTheLineOpenForIt) {
  add_neighbour();
  bool is_written = false;
  script().then([&](ByteView request) {
    const Bytes asked(request.begin(), request.end());
    if (asked == kWrite50) {
      is_written = true;
      plc.answer(request);
      return Bytes{};
    }
    if (is_written) asio::post(io, [&] { worker->stop(); });
    return plc.answer(request);
  });
  start();
  wait([&] { return !of_device(1).empty(); });
  submit(write_setpoint("a"));
  wait([&] { return ended; });
  EXPECT_EQ(ending_of("a"), "SUCCEEDED");
  EXPECT_EQ(wire->opened(), 1U);
}

/// Two devices leave each second read unanswered, so they are never silent for long.
TEST_F(LinkWorkerWithSetpoint, CommandGoesAlthoughTwoDevicesLeaveReadsUnanswered) {
  config.devices[0].groups[0].interval = std::chrono::hours(1);
  std::vector<Bytes> lost;
  for (const std::uint32_t n : {1U, 2U}) {
    config.devices.push_back(port_device("press" + std::to_string(n + 1)));
    DeviceConfig& device = config.devices[n];
    device.timeout = milliseconds(50);
    device.groups[0].interval = milliseconds(0);
    device.tags.push_back(tag(*device.codec, "a", "D" + std::to_string(200 + 10 * n)));
    device.tags.push_back(tag(*device.codec, "b", "D" + std::to_string(900 + 10 * n)));
    lost.push_back(read_frame(kD200 + 2 * (700 + 10 * n), 2));
  }
  int silences = 0;
  script().then([&](ByteView request) {
    const Bytes asked(request.begin(), request.end());
    const bool is_lost = std::ranges::find(lost, asked) != lost.end();
    silences += is_lost;
    return is_lost ? Bytes{} : plc.answer(request);
  });
  start();
  wait([&] { return silences >= 4; });
  submit(write_setpoint("first"));
  EXPECT_EQ(wait_for_result("first").status, CommandStatus::succeeded);
}

TEST_F(LinkWorkerWithSetpoint, AnsweredCommandEndsTheBackOff) {
  plc.silent = true;
  start();
  wait_for_state(State::offline, "timeout");
  plc.silent = false;
  submit(write_setpoint("b7e1"));
  EXPECT_EQ(wait_for_result("b7e1").status, CommandStatus::succeeded);
  wait_for_state(State::online, "");
}

TEST_F(LinkWorkerTest, LinkThatWillNotOpenMakesEveryTagBadAndLeavesTheThreadFree) {
  // The group has no interval: the scheduler must not offer it continuously while the link is down.
  script().refuse_open("no such adapter");
  start();
  wait([&] { return !telemetry.empty(); });
  wait_for_the_thread();
  EXPECT_EQ(telemetry[0].readings[0].bad, BadReason::link_down);
  EXPECT_EQ(state().state, State::offline);
  EXPECT_EQ(state().reason, "link_down");
  wait_for_state(State::online, "");  // the second attempt to open succeeds
  EXPECT_EQ(wire->opened(), 2U);
}

TEST_F(LinkWorkerTest, GroupThatNoWayReachesLeavesTheThreadFree) {
  config.devices[0] = press("press1", port_codec(fx::Model::unknown_fx));
  config.devices[0].tags[0] = tag(*config.devices[0].codec, "far", "D7000");
  plc.set(kD8001, word(24310));
  plc.set(kD8101, word(0));  // neither an FX2N nor an FX3U
  start();
  wait_for_state(State::degraded, "model_unknown");
  wait([&] { return !telemetry.empty(); });
  EXPECT_EQ(telemetry[0].readings[0].bad, BadReason::unsupported);
  wait_for_the_thread();
}

TEST_F(LinkWorkerTest, NoGroupIsPolledBeforeItsLinkOpens) {
  config.links[0].char_time = milliseconds(1);
  const LinkConfig line = config.links[0];
  config.links.assign(1000, line);  // enough to spread their starts
  config.devices[0].groups[0].interval = milliseconds(100);
  config.devices.resize(8, config.devices[0]);
  start();
  wait([&] { return telemetry.size() >= 8; });
  for (const Telemetry& message : telemetry) EXPECT_EQ(message.readings[0].bad, std::nullopt);
}

TEST_F(LinkWorkerTest, LostLinkIsOpenedAgainByItself) {
  script().expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(7));
  wire->expect(kReadD100).hang_up();
  plc.set(kD100, word(8));
  start();
  wait([&] {
    return wire->opened() == 2 && telemetry.back().readings[0].value == number(8) &&
           !telemetry.back().readings[0].bad;
  });
  ASSERT_GE(telemetry.size(), 3U);
  EXPECT_EQ(telemetry[1].readings[0].bad, BadReason::link_down);
  EXPECT_EQ(telemetry[1].readings[0].value, number(7)) << "the last good one";
  EXPECT_EQ(state().state, State::online);
}

TEST_F(LinkWorkerTest, LinkThatComesBackIsReadAtOnceWhateverTheInterval) {
  config.devices[0].groups[0].interval = std::chrono::hours(1);
  config.devices[0].groups[1].interval = std::chrono::hours(1);
  add_setpoint();
  config.devices[0].tags[1].group = 1;
  script().refuse_open("no such adapter");
  start();
  wait([&] { return telemetry.size() >= 2; });
  for (const Telemetry& message : telemetry)
    EXPECT_EQ(message.readings[0].bad, BadReason::link_down);
  wait([&] { return telemetry.size() >= 4; });
  ASSERT_EQ(telemetry.size(), 4U);
  for (std::size_t i = 2; i < 4; ++i) EXPECT_FALSE(telemetry[i].readings[0].bad);
  EXPECT_EQ(state().state, State::online);
  EXPECT_EQ(state().reason, "");
}

TEST_F(LinkWorkerTest, DeviceThatAnswersAgainIsReadAtOnceWhateverTheInterval) {
  config.devices[0].retries = 0;
  config.devices[0].groups[0].interval = std::chrono::hours(1);
  plc.silent = true;
  add_setpoint();
  start();
  wait([&] { return !telemetry.empty(); });
  EXPECT_EQ(telemetry[0].readings[0].bad, BadReason::timeout);
  EXPECT_EQ(state().reason, "timeout");
  plc.silent = false;
  submit(write_setpoint("b7e1"));
  wait([&] { return telemetry.size() >= 3; });
  EXPECT_FALSE(telemetry.back().partial);
  EXPECT_FALSE(telemetry.back().readings[0].bad);
  wait_for_state(State::online, "");
}

TEST_F(LinkWorkerTest, ValuesOfADoubtedBusAreBadFramesUntilItIsBelievedAgain) {
  plc.set(kD100, word(234));
  bool twice = false;
  answer_twice_if(twice);
  start();
  wait([&] { return !telemetry.empty(); });
  EXPECT_EQ(telemetry[0].readings[0].value, number(234));
  twice = true;
  wait_for_state(State::degraded, "bad_frame");
  const std::size_t in_doubt = telemetry.size();
  wait([&] { return telemetry.size() >= in_doubt + 10; });
  for (std::size_t i = in_doubt; i < telemetry.size(); ++i)
    EXPECT_EQ(telemetry[i].readings[0].bad, BadReason::bad_frame) << i;
  const FieldHealth health = reported();
  EXPECT_EQ(health.links[0].doubts, 1U);
  EXPECT_TRUE(health.links[0].doubted);
  EXPECT_GT(health.links[0].unexpected_bytes, 0U);
  twice = false;
  wait_for_state(State::online, "");
  EXPECT_FALSE(telemetry.back().readings[0].bad);
}

TEST_F(LinkWorkerTest, DoubtThatComesBackWithinAMinuteIsLoggedOnce) {
  bool twice = false;
  answer_twice_if(twice);
  start();
  wait([&] { return !telemetry.empty(); });
  testing::internal::CaptureStderr();
  for (int doubts = 0; doubts < 2; ++doubts) {
    twice = true;
    wait_for_state(State::degraded, "bad_frame");
    twice = false;
    wait_for_state(State::online, "");
  }
  const std::string log = testing::internal::GetCapturedStderr();
  const FieldHealth health = reported();
  EXPECT_EQ(health.links[0].doubts, 2U);
  const std::size_t first = log.find("state=doubted");
  ASSERT_NE(first, std::string::npos) << log;
  EXPECT_EQ(log.find("state=doubted", first + 1), std::string::npos) << log;
}

TEST_F(LinkWorkerTest, WholeCycleIsBadInWhichForeignBytesWereFound) {
  // Two reads: the bytes after the second show that the first may have been another's answer.
  add_tag("far", "D200");
  config.devices[0].max_block_bytes = 2;
  config.devices[0].retries = 0;
  script().expect(kEnq).give(kAck);
  wire->expect(kReadD100).give(word_frame(1));
  wire->expect(read_frame(kD200, 2)).give(joined(word_frame(1), word_frame(2)));
  start();
  wait([&] { return !telemetry.empty(); });
  ASSERT_EQ(telemetry[0].readings.size(), 2U);
  EXPECT_EQ(telemetry[0].readings[0].bad, BadReason::bad_frame);
  EXPECT_EQ(telemetry[0].readings[1].bad, BadReason::bad_frame);
}

TEST_F(LinkWorkerTest, ChannelThatNeverFallsSilentIsClosedAndBacksOff) {
  script().give(Bytes(65536, 0x55)).call([] {}).give(Bytes(65536, 0x55));
  expect_two_pauses();
}

TEST_F(LinkWorkerTest, ChannelThatFloodsAgainAndAgainWhenItIsAskedBacksOffLongerEachTime) {
  script();
  for (int i = 0; i < 2; ++i) wire->expect(kEnq).give(Bytes(65536 + 8192, 0x55));
  expect_two_pauses();
}

TEST_F(LinkWorkerTest, BugInAPollDoesNotEndTheLink) {
  script().expect(kEnq).give(kAck);
  wire->expect(kReadD100).call([] { throw std::logic_error("a bug"); });
  start();
  wait([&] { return !telemetry.empty(); });
  EXPECT_EQ(telemetry[0].readings[0].value, number(0)) << "the link began anew";
}

TEST_F(LinkWorkerWithSetpoint, BugUnderACommandAnswersItAndTheNextOnes) {
  config.devices[0].groups[0].interval = std::chrono::hours(1);
  script().expect(kEnq).give(kAck);
  wire->expect(kWrite50).call([] { throw std::logic_error("a bug"); });
  start(Polling::off);
  submit(write_setpoint("a"));
  submit(write_setpoint("b"));
  EXPECT_EQ(wait_for_result("a").status, CommandStatus::unknown_outcome);
  EXPECT_EQ(wait_for_result("b").status, CommandStatus::succeeded);
  submit(write_setpoint("a"));
  wait([&] { return results.size() >= 3; });
  EXPECT_EQ(results.back().status, CommandStatus::duplicate) << "it is not carried out again";
}

TEST_F(LinkWorkerTest, TcpPeerThatNeverAnswersIsLeftAndConnectedAnew) {
  config.links[0].channel = TcpSettings{"192.0.2.10", 5551};
  config.devices[0].groups[0].interval = milliseconds(2);
  plc.silent = true;
  start();
  wait([&] { return wire->opened() >= 2; });
  EXPECT_EQ(plc.asked().size(), 3U);
  plc.silent = false;
  wait_for_state(State::online, "");
}

TEST_F(LinkWorkerTest, StoppingWhileItListensIsNoLoss) {
  config.links[0].channel = TcpSettings{"192.0.2.10", 5551};
  script().hang();
  testing::internal::CaptureStderr();
  start();
  wait([&] { return wire->steps_left() == 0; });
  stop();
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_EQ(log.find("state=down"), std::string::npos) << log;
}

// ---- a stream that needs a new connection after each silence -----------------------------------

/// MC protocol in 3E frames over TCP, without numbers.
struct StreamWithoutNumbers : LinkWorkerTest {
  StreamWithoutNumbers() {
    config.links[0].channel = TcpSettings{"192.0.2.10", 5007};
    config.devices.clear();
    script().then([this](ByteView request) { return answer(request); });
  }
  void add_network(unsigned network) {
    config.devices.push_back(device_on(
        "mc-3e",
        codec_of("mc-3e", {{"network", std::int64_t{network}}, {"model", std::string("FX5U")}}),
        "plc" + std::to_string(network)));
    DeviceConfig& device = config.devices.back();
    device.groups[0].interval = milliseconds(5);
    device.tags.push_back(tag(*device.codec, "temp", "D100"));
  }
  /// Answers a batch read with words of 0.
  Bytes answer(ByteView request) {
    const bool answers = request.size() == 21 && there.contains(request[2]);
    if (!answers) return {};
    if (garbled.contains(request[2]) || request[18] == garbled_space) return Bytes(20, 0xFF);
    const std::size_t bytes = 2U * request[19];
    Bytes out{0xD0, 0x00, request[2], request[3], request[4], request[5], request[6]};
    out.push_back(static_cast<std::uint8_t>(2 + bytes));
    out.resize(out.size() + 3 + bytes);
    return out;
  }
  /// The reasons of a device's states, without "starting".
  std::vector<std::string> reasons(std::uint32_t device) const {
    std::vector<std::string> out;
    for (const DeviceStatus& status : states)
      if (status.device == device && status.reason != "starting") out.push_back(status.reason);
    return out;
  }

  std::set<unsigned> there;    ///< networks whose PLC answers
  std::set<unsigned> garbled;  ///< those of them that answer with nonsense
  int garbled_space = -1;      ///< code of a device that all answer so; W is 0xB4
};

TEST_F(StreamWithoutNumbers, DeviceThatNeverAnswersTimesOutAndTheLogSaysWhatToLookAt) {
  add_network(1);
  testing::internal::CaptureStderr();
  start();
  wait([&] { return wire->opened() >= 5; });
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_EQ(reasons(0), std::vector<std::string>{"timeout"});
  EXPECT_EQ(log.find("the line was lost"), std::string::npos) << log;
  EXPECT_EQ(log.find("state=down"), log.rfind("state=down")) << log;
  EXPECT_EQ(log.find("state=up"), log.rfind("state=up")) << log;
  const DeviceConfig& device = config.devices[0];
  expect_says(
      log, checklist_of(device, *device.codec, wiring_of(config.links[0], device), Answers::none));
  there = {1};
  wait_for_state(State::online, "");
}

TEST_F(StreamWithoutNumbers, OneSilenceIsNoLoss) {
  add_network(1);
  there = {1};
  start();
  wait_for_state(State::online, "");
  there.clear();
  wait([&] { return wire->opened() >= 2; });
  there = {1};
  const std::size_t asked = wire->written().size();
  wait([&] { return wire->written().size() >= asked + 10; });
  for (const DeviceStatus& status : states)
    EXPECT_TRUE(status.state != State::offline || status.reason == "starting") << status.reason;
}

TEST_F(StreamWithoutNumbers, NeighbourOfASilentDeviceStaysOnline) {
  add_network(1);
  add_network(2);
  there = {2};
  testing::internal::CaptureStderr();
  start();
  wait([&] { return !reasons(0).empty() && wire->opened() >= 4; });
  const std::size_t asked = wire->written().size();
  wait([&] { return wire->written().size() >= asked + 10; });
  const std::string log = testing::internal::GetCapturedStderr();
  // Possibly twice: the checklist is shorter once the neighbour has answered.
  for (const std::string& reason : reasons(0)) EXPECT_EQ(reason, "timeout");
  for (const std::string& reason : reasons(1)) EXPECT_EQ(reason, "");
  EXPECT_EQ(log.find("state=down"), std::string::npos) << log;
}

TEST_F(StreamWithoutNumbers, NeighbourOfADeviceThatAnswersNonsenseStaysOnline) {
  add_network(1);
  add_network(2);
  there = {1, 2};
  start();
  wait([&] { return !reasons(0).empty() && !reasons(1).empty(); });
  testing::internal::CaptureStderr();
  garbled = {1};
  const std::size_t opened = wire->opened();
  wait([&] { return reasons(0).back() == "bad_frame" && wire->opened() >= opened + 4; });
  wait_for_requests(10);
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_EQ(reasons(0).back(), "bad_frame");
  for (const std::string& reason : reasons(1)) EXPECT_EQ(reason, "");
  EXPECT_EQ(log.find("the line was lost"), std::string::npos) << log;
}

TEST_F(StreamWithoutNumbers, DeviceThatOnlyAnswersNonsenseRestsAndItsNeighbourIsPolledOn) {
  add_network(1);
  add_network(2);
  there = {1, 2};
  start();
  wait([&] { return !of_device(0).empty() && !of_device(1).empty(); });
  garbled = {1};
  const std::size_t opened = wire->opened();
  const std::size_t polled = of_device(1).size();
  wait([&] { return of_device(1).size() >= polled + 200; });
  EXPECT_LT(wire->opened() - opened, 50U) << "it was asked as often as its neighbour";
  EXPECT_GE(wire->opened() - opened, 3U);
  garbled.clear();
  wait([&] { return reasons(0).back().empty(); });
}

TEST_F(StreamWithoutNumbers, OnePlaceThatAnswersNonsenseDoesNotMakeTheOthersRest) {
  add_network(1);
  config.devices[0].groups.push_back(group("strange", milliseconds(5)));
  config.devices[0].tags.push_back(tag(*config.devices[0].codec, "strange", "W5"));
  config.devices[0].tags.back().group = 1;
  there = {1};
  garbled_space = 0xB4;
  start();
  const auto polls = [&](std::uint32_t group) {
    return std::ranges::count(of_device(0), group, &Telemetry::group);
  };
  wait([&] { return polls(0) >= 200; });
  EXPECT_LT(polls(1), 50);
}

TEST_F(StreamWithoutNumbers, PeerThatHasOnlyAnsweredNonsenseIsALoss) {
  add_network(1);
  there = garbled = {1};
  testing::internal::CaptureStderr();
  start();
  wait([&] { return wire->opened() >= 5; });
  expect_says(testing::internal::GetCapturedStderr(), "the line was lost");
  garbled.clear();
  wait_for_state(State::online, "");
}

// ---- commands ----------------------------------------------------------------------------------

TEST_F(LinkWorkerTest, CommandGoesAfterTheExchangeOnTheWireAndBeforeTheNextPoll) {
  add_setpoint("D2000");
  const Bytes write = port_frame("E10" + hex_text(0x4000 + 4000, 4) + "023200");
  script().expect(kEnq).give(kAck).expect(kReadD100).call([&] { submit(write_setpoint("b7e1")); });
  wire->give(word_frame(7)).expect(write).give(kAck);
  start();
  const CommandResult& result = wait_for_result("b7e1");
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.plc, PlcAnswer::ack);
  EXPECT_GE(result.queue.count(), 0);
  EXPECT_FALSE(result.bound) << "a line of unknown speed has no bound";
}

/// Marks on a disk that never answers.
class HangingMarks final : public CommandStarts {
 public:
  void mark(std::uint64_t, Done) override { is_asked = true; }
  milliseconds patience() const override { return milliseconds(200); }
  bool is_asked = false;
};

TEST_F(LinkWorkerWithSetpoint, DiskThatHangsUnderAMarkHoldsUpNoOtherLink) {
  config.links.push_back({"line2", SerialSettings{}, nanoseconds(0)});
  config.devices.push_back(press("press2"));
  config.devices[1].link = 1;
  start();
  FakePort neighbours_plc;
  auto neighbours_wire = std::make_unique<ScriptedTransport>(io.get_executor());
  neighbours_wire->then([&](ByteView request) { return neighbours_plc.answer(request); });
  LinkWorker neighbour(io.get_executor(), config, 1, devices_by_link(config)[1], outbox,
                       std::move(neighbours_wire), std::vector<std::uint64_t>(8, 100), Polling::on);
  bool neighbour_ended = false;
  asio::co_spawn(io, neighbour.run(), [&](const std::exception_ptr&) { neighbour_ended = true; });
  HangingMarks marks;
  auto decision = admission(0).admit(write_setpoint("unmarked"), codec(0), 0, Clock::now());
  std::get<AdmittedCommand>(decision).starts = &marks;
  worker->submit(std::move(std::get<AdmittedCommand>(decision)));
  wait([&] { return marks.is_asked; });
  const std::size_t polls = of_device(1).size();
  const CommandResult& result = wait_for_result("unmarked");
  EXPECT_GT(of_device(1).size(), polls + 5);
  EXPECT_EQ(ending(result), "FAILED store_unavailable");
  for (const std::string& asked : plc.asked()) EXPECT_EQ(asked.find("write"), std::string::npos);
  const std::size_t own_polls = of_device(0).size();
  wait([&] { return of_device(0).size() > own_polls; });
  neighbour.stop();
  run_until(io, [&] { return neighbour_ended; });
}

TEST_F(LinkWorkerWithSetpoint, WrittenValueIsPublishedAtOnce) {
  config.devices[0].groups[0].interval = std::chrono::hours(1);
  config.devices[0].groups[0].on_change = true;
  start(Polling::on);
  submit(write_setpoint("b7e1"));
  wait_for_result("b7e1");
  Command verified = write_setpoint("b7e2", 51);
  verified.verify = true;
  submit(verified);
  wait_for_result("b7e2");
  std::vector<Telemetry> partial;
  for (const Telemetry& message : telemetry)
    if (message.partial) partial.push_back(message);
  ASSERT_EQ(partial.size(), 2U);
  EXPECT_TRUE(partial[0].written) << "nothing was read back";
  ASSERT_EQ(partial[0].readings.size(), 1U);
  EXPECT_EQ(partial[0].readings[0].tag, 1U);
  EXPECT_EQ(partial[0].readings[0].value, number(50));
  EXPECT_FALSE(partial[1].written);
  EXPECT_EQ(partial[1].readings[0].value, number(51));
  EXPECT_LT(partial[0].seq, partial[1].seq) << "it counts as a sample";
}

TEST_F(LinkWorkerWithSetpoint, RefusedWriteAndRawAddressPublishNothing) {
  config.devices[0].commands.allow.push_back(
      *config.devices[0].codec->addresses().parse_range("D300"));
  bool refuses = true;
  script().then([&](ByteView request) {
    const bool is_write = request.size() > 1 && request[1] == '1';
    return is_write && refuses ? kNak : plc.answer(request);
  });
  start();
  submit(write_setpoint("refused"));
  EXPECT_EQ(wait_for_result("refused").reason, Reason::nak);
  refuses = false;
  Command raw = write_setpoint("raw");
  raw.targets[0].tag.clear();
  raw.targets[0].address = "D300";
  submit(raw);
  EXPECT_EQ(wait_for_result("raw").status, CommandStatus::succeeded);
  for (const Telemetry& message : telemetry) EXPECT_FALSE(message.partial);
}

TEST_F(LinkWorkerTest, PollThatWasUnderWayCarriesTheWrittenValue) {
  // The cycle reads D200, the command writes it, then the cycle continues and ends: its value is
  // older than its message may contain.
  add_setpoint("D200");
  config.devices[0].tags[0] = tag(*config.devices[0].codec, "clock", "D8010");
  script().expect(kEnq).give(kAck);
  wire->expect(read_frame(kD200, 2)).call([&] { submit(write_setpoint("b7e1")); });
  wire->give(word_frame(40)).expect(kWrite50).give(kAck);
  wire->expect(read_frame(0x0E14, 2)).give(word_frame(1));
  start();
  wait([&] { return telemetry.size() >= 2; });
  EXPECT_TRUE(telemetry[0].partial);
  EXPECT_EQ(telemetry[0].readings.at(0).value, number(50));
  EXPECT_FALSE(telemetry[1].partial);
  EXPECT_EQ(telemetry[1].readings.at(1).value, number(50)) << "and not the 40 that it read";
}

/// Tags that show D200 in all shapes, and "clock", which a cycle reads after them.
struct LinkWorkerStaleTest : LinkWorkerTest {
  LinkWorkerStaleTest() {
    DeviceConfig& device = config.devices[0];
    const Codec& codec = *device.codec;
    device.retries = 0;
    device.tags[0] = tag(codec, "clock", "D8010");
    add_setpoint("D200");
    device.tags.push_back(tag(codec, "same", "D200"));
    device.tags.push_back(tag(codec, "wide", "D199", DataType::int32));
    device.tags.push_back(tag(codec, "bit", "D200.1", DataType::boolean));
    device.tags.push_back(array_of(tag(codec, "row", "D198"), 4));
    device.commands.allow.push_back(*codec.addresses().parse_range("D200"));
    plc.set(kD200, word(40));
  }
  Command write_raw(std::string id, std::int64_t value) {
    Command command = write_setpoint(std::move(id), value);
    command.targets[0].tag.clear();
    command.targets[0].address = "D200";
    return command;
  }
  /// Runs `action` when the first cycle has read D200 and not yet the rest.
  void after_the_first_read(std::function<void()> action) {
    script().then([this, action = std::move(action)](ByteView request) mutable {
      const Bytes answer = reply(request);
      if (plc.count(kReadThem) > 0 && action) std::exchange(action, nullptr)();
      return answer;
    });
  }
  /// The next write is not answered, and is carried out after `reads` further reads of D200.
  void swallow_write(std::size_t reads) { late_after_ = reads; }
  /// Returns the first message with the whole group.
  const Telemetry& first_cycle() {
    const auto whole = [](const Telemetry& message) { return !message.partial; };
    wait([&] { return std::any_of(telemetry.begin(), telemetry.end(), whole); });
    const auto found = std::find_if(telemetry.begin(), telemetry.end(), whole);
    static const Telemetry nothing;
    return found != telemetry.end() ? *found : nothing;
  }
  static void expect_all_show(const Telemetry& message, std::int64_t value) {
    ASSERT_EQ(message.readings.size(), 6U);
    for (const TagReading& reading : message.readings) EXPECT_FALSE(reading.bad) << reading.tag;
    EXPECT_EQ(message.readings.at(1).value, number(value));
    EXPECT_EQ(message.readings.at(2).value, number(value));
    EXPECT_EQ(message.readings.at(3).value, number(value << 16));
    EXPECT_EQ(message.readings.at(4).value, flag((value & 2) != 0));
    EXPECT_EQ(message.readings.at(5).value, numbers({0, 0, value, 0}));
  }

  const std::string kReadThem = "read 118C 8";

 private:
  Bytes reply(ByteView request) {
    const bool is_write = request.size() > 1 && request[1] == '1';
    if (is_write && late_after_) return {};
    const Bytes answer = plc.answer(request);
    if (late_after_ && plc.asked().back() == "read 1190 2" && --*late_after_ == 0) {
      plc.set(kD200, word(50));
      late_after_.reset();
    }
    return answer;
  }
  std::optional<std::size_t> late_after_;
};

TEST_F(LinkWorkerStaleTest, CycleUnderWayShowsWhatARawWriteWroteInEveryTagOfThatPlace) {
  after_the_first_read([&] { submit(write_raw("raw", 50)); });
  start();
  expect_all_show(first_cycle(), 50);
  EXPECT_EQ(plc.count(kReadThem), 1U) << "what was acknowledged need not be read again";
}

TEST_F(LinkWorkerStaleTest, CycleUnderWayShowsWhatATagsWriteWroteInTheOtherTagsToo) {
  after_the_first_read([&] { submit(write_setpoint("tag", 50)); });
  start();
  expect_all_show(first_cycle(), 50);
}

TEST_F(LinkWorkerStaleTest, CycleUnderWayShowsTheNewestOfTwoWrites) {
  after_the_first_read([&] {
    submit(write_setpoint("tag", 50));
    submit(write_raw("raw", 51));
  });
  start();
  expect_all_show(first_cycle(), 51);
}

TEST_F(LinkWorkerStaleTest, CycleUnderWayReadsAnewWhatAWriteWithoutAnAnswerMayHaveChanged) {
  // The read-back still returns the old value, so the outcome is unknown; then the PLC carries out
  // the write.
  swallow_write(1);
  after_the_first_read([&] { submit(write_raw("lost", 50)); });
  start();
  expect_all_show(first_cycle(), 50);
  EXPECT_EQ(wait_for_result("lost").status, CommandStatus::unknown_outcome);
}

TEST_F(LinkWorkerStaleTest, CycleUnderWayShowsTheByteBehindATextOfOddLengthAsTheDeviceKeptIt) {
  plc.set(kD200 + 2, word(0x7900));
  const Codec& codec = *config.devices[0].codec;
  config.devices[0].commands.allow.push_back(*codec.addresses().parse_range("D201"));
  after_the_first_read([&] {
    Command command = write_raw("text", 0);
    command.targets[0].type = DataType::string;
    command.targets[0].value = text("abc");
    submit(command);
  });
  start();
  const Telemetry& message = first_cycle();
  EXPECT_EQ(wait_for_result("text").detail, "");
  ASSERT_EQ(message.readings.size(), 6U);
  EXPECT_EQ(message.readings[2].value, number(0x6261));
  EXPECT_EQ(message.readings[5].value, numbers({0, 0, 0x6261, 0x7963}));
}

TEST_F(LinkWorkerStaleTest, LastValueOfABadTagIsNotOlderThanAWrite) {
  config.devices[0].groups[0].interval = milliseconds(200);
  start();
  first_cycle();
  submit(write_raw("raw", 50));
  EXPECT_EQ(wait_for_result("raw").status, CommandStatus::succeeded);
  plc.silent = true;
  wait([&] { return telemetry.back().readings[0].bad.has_value(); });
  ASSERT_EQ(telemetry.back().readings.size(), 6U);
  const Telemetry& silent = telemetry.back();
  EXPECT_FALSE(silent.readings[0].value.items.empty()) << "nobody wrote there";
  for (std::size_t i = 1; i < silent.readings.size(); ++i) {
    EXPECT_TRUE(silent.readings[i].value.items.empty()) << i;
    EXPECT_EQ(silent.readings[i].last_ms, 0) << i;
  }
}

TEST_F(LinkWorkerWithSetpoint, ResultCarriesTheFramesOfItsCommandAndTheMemoryOfIdsDoesNot) {
  start();
  wait([&] { return !telemetry.empty(); });
  Command command = write_setpoint("b7e1");
  command.number = 7;
  submit(command);
  const CommandResult& result = wait_for_result("b7e1");
  EXPECT_EQ(result.number, 7U);
  ASSERT_EQ(result.frames.frames().size(), 2U);
  EXPECT_EQ(result.frames.frames()[0].way, WireFrame::Way::out);
  EXPECT_EQ(result.frames.frames()[0].bytes, write_frame(kD200, word(50)));
  EXPECT_EQ(result.frames.frames()[1].way, WireFrame::Way::in);
  EXPECT_EQ(result.frames.frames()[1].bytes, kAck);
  results.clear();
  submit(write_setpoint("b7e1"));
  const CommandResult& again = wait_for_result("b7e1");
  ASSERT_NE(again.first, nullptr);
  EXPECT_TRUE(again.first->frames.frames().empty());
  stop();
}

TEST_F(LinkWorkerWithSetpoint, InterruptedCommandOfAnEarlierRunIsReadAndNotSent) {
  interrupted = {write_setpoint("left")};
  interrupted[0].number = 3;
  start();
  const CommandResult& result = wait_for_result("left");
  EXPECT_EQ(result.status, CommandStatus::unknown_outcome);
  EXPECT_EQ(result.number, 3U);
  const Bytes write = write_frame(kD200, word(50));
  for (const Bytes& sent : wire->written()) EXPECT_NE(sent, write);
  stop();
}

TEST_F(LinkWorkerWithSetpoint, InterruptedCommandIsReadDuringAConflictToo) {
  interrupted = {write_setpoint("left")};
  plc.set(kD200, word(50));
  outbox.set_conflict(true);
  start();
  EXPECT_EQ(wait_for_result("left").status, CommandStatus::succeeded);
  stop();
}

TEST_F(LinkWorkerWithSetpoint, InterruptedCommandThatStillWaitsAtTheEndIsUnknownAndNotRejected) {
  interrupted = {write_setpoint("left")};
  start();
  stop();
  const CommandResult* result = result_of("left");
  ASSERT_NE(result, nullptr);
  EXPECT_EQ(result->status, CommandStatus::unknown_outcome);
}

TEST_F(LinkWorkerTest, ReadAfterTheWriteIsTheNewest) {
  add_setpoint("D200");
  config.devices[0].tags[0] = tag(*config.devices[0].codec, "running", "M0");
  script().expect(kEnq).give(kAck);
  wire->expect(read_frame(kM0, 1)).call([&] { submit(write_setpoint("b7e1")); });
  wire->give(data_frame({0x00})).expect(kWrite50).give(kAck);
  wire->expect(read_frame(kD200, 2)).give(word_frame(45));  // written by the ladder
  start();
  wait([&] { return telemetry.size() >= 2; });
  EXPECT_EQ(telemetry[1].readings.at(1).value, number(45));
}

TEST_F(LinkWorkerWithSetpoint, SameIdIsCarriedOutOnce) {
  start();
  submit(write_setpoint("b7e1"));
  submit(write_setpoint("b7e1"));
  wait([&] { return results.size() >= 2; });
  submit(write_setpoint("b7e1"));
  wait([&] { return results.size() >= 3; });
  EXPECT_EQ(results[0].status, CommandStatus::duplicate);
  EXPECT_EQ(results[0].first, nullptr) << "still waiting";
  EXPECT_EQ(results[1].status, CommandStatus::succeeded);
  EXPECT_EQ(results[2].status, CommandStatus::duplicate);
  ASSERT_NE(results[2].first, nullptr);
  EXPECT_EQ(results[2].first->status, CommandStatus::succeeded);
  EXPECT_EQ(plc.count("write 1190 3200"), 1U);
}

TEST_F(LinkWorkerTest, BoundCoversAHealthyLine) {
  // The PLC of these tests answers at once, so this test computes the line time from the traffic:
  // one character time for each character, plus the PLC's own time.
  const milliseconds character{8};  // 1200 baud
  config.links[0].char_time = character;
  config.links[0].poll_share = 0;  // uses real time; PollSchedulerBound tests it
  add_setpoint();
  constexpr int kCommands = 20;
  std::vector<nanoseconds> arrived(kCommands);
  std::vector<nanoseconds> done(kCommands);
  nanoseconds line{0};
  int sent = 0;
  int written = -1;
  script().then([&](ByteView request) {
    const Bytes asked(request.begin(), request.end());
    // The worst moment: a poll has just begun. Bursts of five, so that some commands wait for
    // others.
    for (int i = 0; asked == kReadD100 && telemetry.size() >= 3 && i < 5 && sent < kCommands; ++i) {
      arrived[static_cast<std::size_t>(sent)] = line;
      Command command = write_setpoint("c" + std::to_string(sent), 1000 + sent);
      command.verify = true;
      submit(command);
      ++sent;
    }
    const Bytes answer = plc.answer(request);
    line += (request.size() + answer.size()) * character + milliseconds(30);
    for (int i = 0; i < sent; ++i)
      if (asked == write_frame(kD200, word(1000U + static_cast<unsigned>(i)))) written = i;
    if (asked == read_frame(kD200, 2) && written >= 0) {  // its read-back
      done[static_cast<std::size_t>(written)] = line;
      written = -1;
    }
    return answer;
  });
  start();
  wait([&] { return results.size() >= kCommands; });
  double tightest = 0;
  for (std::size_t i = 0; i < kCommands; ++i) {
    const CommandResult* result = result_of("c" + std::to_string(i));
    ASSERT_NE(result, nullptr) << i;
    ASSERT_EQ(result->status, CommandStatus::succeeded) << i;
    ASSERT_TRUE(result->bound) << i;
    ASSERT_GT(done[i], arrived[i]) << i;
    EXPECT_LE(done[i] - arrived[i], *result->bound) << i;
    tightest = std::max(tightest, static_cast<double>((done[i] - arrived[i]).count()) /
                                      static_cast<double>(result->bound->count()));
  }
  EXPECT_GT(tightest, 0.9) << "a bound that nothing comes near says little";
}

TEST_F(LinkWorkerTest, BoundCountsTheCommandThatIsOnTheWire) {
  const milliseconds character{8};
  config.links[0].char_time = character;
  config.links[0].poll_share = 0;
  add_setpoint();
  bool is_running = false;
  script().then([&](ByteView request) {
    const Bytes asked(request.begin(), request.end());
    if (asked == write_frame(kD200, word(77)) && !std::exchange(is_running, true))
      submit(write_setpoint("behind"));
    return plc.answer(request);
  });
  start();
  submit(write_setpoint("first"));  // includes the enquiry
  wait_for_result("first");
  submit(write_setpoint("alone"));
  const nanoseconds alone = wait_for_result("alone").bound.value_or(nanoseconds(0));
  submit(write_setpoint("running", 77));
  const nanoseconds behind = wait_for_result("behind").bound.value_or(nanoseconds(0));
  EXPECT_TRUE(is_running);
  EXPECT_GE(behind - alone,
            (write_frame(kD200, word(77)).size() + kAck.size()) * character + milliseconds(30));
}

TEST_F(LinkWorkerWithSetpoint, BoundHasRoomForWhatTheLinkLeavesToPolls) {
  config.links[0].char_time = nanoseconds(1000);
  const auto of_one_ahead = [&](double share) {
    config.links[0].poll_share = share;
    start();
    for (const char* id : {"a", "b", "c"}) submit(write_setpoint(id));
    wait([&] { return results.size() >= 3; });
    const nanoseconds more = *result_of("c")->bound - *result_of("b")->bound;
    stop();
    worker.reset();
    results.clear();
    admissions.clear();
    ended = false;
    return more;
  };
  const nanoseconds without_polls = of_one_ahead(0.0);
  EXPECT_NEAR(static_cast<double>(of_one_ahead(0.5).count()),
              static_cast<double>(2 * without_polls.count()), 2.0);
}

TEST_F(LinkWorkerTest, BoundCountsTheEnquiryThatIsStillToCome) {
  config.links[0].char_time = milliseconds(8);
  add_setpoint();
  start();
  submit(write_setpoint("first"));
  const nanoseconds first = wait_for_result("first").bound.value_or(nanoseconds(0));
  submit(write_setpoint("later"));
  const nanoseconds later = wait_for_result("later").bound.value_or(nanoseconds(0));
  // ENQ and ACK, and the PLC's own time.
  EXPECT_EQ(first - later, 2 * milliseconds(8) + milliseconds(30));
}

TEST_F(LinkWorkerTest, BoundCountsTheQuestionsAboutTheModelBeforeARead) {
  config.devices[0] = press("press1", port_codec(fx::Model::unknown_fx));
  config.devices[0].groups[0].interval = milliseconds(5);
  add_tag("far", "D7000");
  config.links[0].char_time = milliseconds(8);
  plc.set(kD8001, word(24310));
  plc.set(kD8101, word(16310));
  add_setpoint();
  start();
  submit(write_setpoint("first"));
  const nanoseconds first = wait_for_result("first").bound.value_or(nanoseconds(0));
  wait([&] { return state().model == "FX3U"; });
  submit(write_setpoint("later"));
  const nanoseconds later = wait_for_result("later").bound.value_or(nanoseconds(0));
  // Two read requests, 11 characters out and 8 back each, and the enquiry.
  EXPECT_GE(first - later, 2 * (19 * milliseconds(8) + milliseconds(30)));
}

TEST_F(LinkWorkerWithSetpoint, WithoutPollingNoGroupIsRead) {
  start(Polling::off);
  submit(write_setpoint("b7e1"));
  EXPECT_EQ(wait_for_result("b7e1").status, CommandStatus::succeeded);
  submit(write_setpoint("b7e2"));
  EXPECT_EQ(wait_for_result("b7e2").status, CommandStatus::succeeded);
  EXPECT_EQ(plc.count("read 10C8 2"), 0U);
  EXPECT_FALSE(std::any_of(telemetry.begin(), telemetry.end(),
                           [](const Telemetry& message) { return !message.partial; }));
}

// ---- the end -----------------------------------------------------------------------------------

TEST_F(LinkWorkerTest, StopCutsAPollShort) {
  config.devices[0].timeout = std::chrono::hours(1);
  script().expect(kEnq).give(kAck).expect(kReadD100).call(
      [&] { asio::post(io, [&] { worker->stop(); }); });
  wire->hang();
  start();
  wait([&] { return ended; });
  EXPECT_TRUE(telemetry.empty()) << "a poll that was cut short tells nothing about the device";
}

TEST_F(LinkWorkerTest, StopEndsAWaitForTheNextPoll) {
  config.devices[0].groups[0].interval = std::chrono::hours(1);
  start();
  wait_for_requests(2);
  const std::size_t requests = wire->written().size();
  worker->stop();
  wait([&] { return ended; });
  EXPECT_EQ(wire->written().size(), requests) << "a stop begins no poll";
}

TEST_F(LinkWorkerWithSetpoint, StopFinishesTheCommandOnTheWireAndAnswersTheWaitingOnes) {
  script().expect(kEnq).give(kAck).expect(kReadD100).call([&] {
    for (int i = 0; i < 4; ++i) submit(write_setpoint("c" + std::to_string(i)));
  });
  wire->give(word_frame(7)).expect(kWrite50).call([&] { worker->stop(); });
  wire->give(kAck);
  start();
  wait([&] { return ended; });
  submit(write_setpoint("late"));
  collect();
  ASSERT_EQ(results.size(), 5U) << "each exactly once";
  submit(write_setpoint("c0"));
  collect();
  ASSERT_EQ(results.size(), 6U);
  EXPECT_EQ(results.back().status, CommandStatus::duplicate);
  ASSERT_NE(results.back().first, nullptr);
  EXPECT_EQ(results.back().first->status, CommandStatus::succeeded);
  results.pop_back();
  EXPECT_EQ(ending_of("c0"), "SUCCEEDED");
  for (const char* id : {"c1", "c2", "c3", "late"}) {
    EXPECT_EQ(ending_of(id), "FAILED shutting_down") << id;
  }
}

TEST_F(LinkWorkerTest, OtherCommandsGoBetweenTheTargetsOfAList) {
  start_list([&] { submit(write_tag("other", "x9")); }, 1);
  wait([&] { return result_of("list") != nullptr && result_of("other") != nullptr; });
  EXPECT_EQ(ending_of("list"), "SUCCEEDED");
  EXPECT_EQ(ending_of("other"), "SUCCEEDED");
  const auto& asked = plc.asked();
  const auto begin = std::find(asked.begin(), asked.end(), write_of(0));
  const auto end = std::find(asked.begin(), asked.end(), write_of(7));
  ASSERT_TRUE(begin < end && end != asked.end());
  EXPECT_EQ(std::count(begin, end, write_of(9)), 1) << "the other command";
  EXPECT_EQ(results.back().id, "list") << "it went on to its end";
}

TEST_F(LinkWorkerTest, CommandForAPlaceThatAListWritesWaitsForItsEnd) {
  start_list([&] { submit(write_tag("other", "x7", 77)); }, 1);
  wait([&] { return result_of("list") != nullptr && result_of("other") != nullptr; });
  EXPECT_EQ(results.front().id, "list");
  EXPECT_EQ(plc.word_at(kD200 + 14), 77U) << "what was ordered last stands";
}

TEST_F(LinkWorkerTest, CommandThatIsLongerThanWhatAListHasHadWaits) {
  // Two of its targets are as long as the other command, which therefore runs after them and not
  // before.
  start_list(
      [&] {
        Command other = write_tag("other", "x8");
        other.targets.push_back({"x9", "", std::nullopt, number(59)});
        other.is_list = true;
        submit(other);
      },
      1);
  wait([&] { return result_of("list") != nullptr && result_of("other") != nullptr; });
  const auto& asked = plc.asked();
  const auto place = [&](int i) {
    return std::find(asked.begin(), asked.end(), write_of(i)) - asked.begin();
  };
  EXPECT_LT(place(1), place(8));
  EXPECT_LT(place(9), place(3));
}

TEST_F(LinkWorkerTest, StopEndsAListBetweenTwoTargets) {
  start_list([&] { worker->stop(); }, 3);
  wait([&] { return ended; });
  ASSERT_NE(result_of("list"), nullptr);
  const CommandResult& result = *result_of("list");
  EXPECT_EQ(ending(result), "PARTIAL shutting_down");
  EXPECT_EQ(result.progress, (Progress{3, 8}));
  ASSERT_EQ(result.targets.size(), 8U);
  EXPECT_EQ(result.targets[2].status, CommandStatus::succeeded);
  EXPECT_EQ(ending(result.targets[3]), "FAILED shutting_down");
  EXPECT_EQ(plc.word_at(kD200 + 4), 52U);
  EXPECT_EQ(plc.word_at(kD200 + 6), 0U);
}

TEST_F(LinkWorkerTest, ConflictEndsAListBetweenTwoTargetsAndRejectsTheWaitingCommands) {
  start_list(
      [&] {
        outbox.set_conflict(true);
        submit(write_tag("waiting", "x9"));
      },
      3);
  wait([&] { return result_of("list") != nullptr && result_of("waiting") != nullptr; });
  EXPECT_EQ(ending_of("list"), "PARTIAL conflict");
  EXPECT_EQ(result_of("list")->progress, (Progress{3, 8}));
  EXPECT_EQ(ending(result_of("list")->targets[3]), "REJECTED conflict");
  EXPECT_EQ(ending_of("waiting"), "REJECTED conflict");
  EXPECT_EQ(std::ranges::count(plc.asked(), write_of(3)), 0);
  EXPECT_EQ(std::ranges::count(plc.asked(), write_of(9)), 0);
}

TEST_F(LinkWorkerWithSetpoint, CommandOnASilentDeviceDoesNotHoldTheStop) {
  config.devices[0].timeout = std::chrono::minutes(10);
  script().expect(kEnq).give(kAck).expect(kReadD100).call([&] { submit(write_setpoint("a")); });
  wire->give(word_frame(7)).expect(kWrite50).call([&] { worker->stop(); });
  wire->hang();
  const auto began = Clock::now();
  start();
  wait([&] { return ended; });
  EXPECT_LT(Clock::now() - began, std::chrono::seconds(10));
  EXPECT_EQ(ending_of("a"), "UNKNOWN_OUTCOME shutting_down");
}

TEST_F(LinkWorkerWithSetpoint, GapBeforeARequestDoesNotHoldTheStop) {
  config.devices[0].gap = std::chrono::minutes(1);
  script().expect(kEnq).call([&] { submit(write_setpoint("a")); });
  wire->call([&] { asio::post(io, [&] { worker->stop(); }); }).give(kAck);
  const auto began = Clock::now();
  start();
  wait([&] { return ended; });
  EXPECT_LT(Clock::now() - began, std::chrono::seconds(10));
  ASSERT_NE(result_of("a"), nullptr);
  EXPECT_EQ(result_of("a")->status, CommandStatus::failed);
}

// ---- a changed config ---------------------------------------------------------------------------

/// press1 and press2 on one link.
struct LinkWorkerChangeTest : LinkWorkerTest {
  LinkWorkerChangeTest() {
    config.devices.push_back(port_device("press2"));
    config.devices[1].tags.push_back(writable(tag(*config.devices[1].codec, "setpoint", "D200")));
    for (DeviceConfig& device : config.devices) device.groups[0].interval = milliseconds(2);
  }
  void remove(std::uint32_t device) {
    const std::array<std::uint32_t, 1> leaving{device};
    worker->remove(leaving, [this](LinkDevices gone) {
      collect();
      std::ranges::move(gone, std::back_inserter(left));
    });
  }
  void add(std::uint32_t device, std::uint64_t seq) {
    const std::array<std::uint32_t, 1> joining{device};
    worker->add(config, joining, std::vector<std::uint64_t>{0, seq});
  }
  LinkDevices left;
  bool removed = false;
};

TEST_F(LinkWorkerChangeTest, DeviceLeavesAndComesBackWhileItsNeighbourIsPolled) {
  start();
  wait([&] { return of_device(0).size() >= 5 && of_device(1).size() >= 5; });
  remove(1);
  wait([&] { return !left.empty(); });
  ASSERT_EQ(left.size(), 1U);
  EXPECT_EQ(left[0]->index, 1U);
  EXPECT_EQ(left[0]->seq, of_device(1).back().seq) << "all that it made is in the outbox";
  EXPECT_EQ(left[0]->collected, left[0]->suppressed + of_device(1).size());
  const std::size_t of_gone = of_device(1).size();
  const std::size_t of_neighbour = of_device(0).size();
  wait([&] { return of_device(0).size() >= of_neighbour + 50; });
  EXPECT_EQ(of_device(1).size(), of_gone);

  states.clear();
  const auto added = std::chrono::steady_clock::now();
  add(1, left[0]->seq);
  wait([&] { return of_device(1).size() >= of_gone + 5; });
  EXPECT_EQ(of_device(1)[of_gone].seq, left[0]->seq + 1) << "its numbers go on";
  wait_for_state(State::online, "", 1);
  for (std::size_t i = 1; i < of_device(0).size(); ++i)
    EXPECT_EQ(of_device(0)[i].seq, of_device(0)[i - 1].seq + 1);
  EXPECT_EQ(wire->opened(), 1U) << "its connection stands";
  const FieldHealth health = reported();
  const auto intervals =
      (std::chrono::steady_clock::now() - added) / config.devices[1].groups[0].interval;
  EXPECT_LE(health.devices[1].missed, static_cast<std::uint64_t>(intervals) + 1)
      << "it is not late by what it was not there";
}

TEST_F(LinkWorkerChangeTest, CommandsThatWaitAreAnsweredAndThoseOfTheNeighbourGoOn) {
  start();
  wait([&] { return !of_device(0).empty() && !of_device(1).empty(); });
  submit(write_setpoint("a", 50, 1));
  submit(write_setpoint("b", 51, 1));
  remove(1);
  submit(write_setpoint("c", 52, 1));  // admitted before the change, delivered after it
  wait([&] { return !left.empty(); });
  for (const char* id : {"a", "b", "c"}) {
    ASSERT_EQ(ending_of(id), "FAILED reloading") << id;
    expect_says(result_of(id)->detail, "config");
  }
  submit(write_setpoint("d", 53, 1));  // the device is gone
  wait([&] { return result_of("d") != nullptr; });
  EXPECT_EQ(result_of("d")->reason, Reason::reloading);
}

TEST_F(LinkWorkerChangeTest, CommandOnTheWireEndsBeforeItsDeviceHasLeft) {
  const Bytes write = write_frame(kD200, word(77));
  script().then([&](ByteView request) {
    if (Bytes(request.begin(), request.end()) == write) {
      remove(1);
      EXPECT_TRUE(left.empty());
    }
    return plc.answer(request);
  });
  start();
  wait([&] { return !of_device(1).empty(); });
  submit(write_setpoint("a", 77, 1));
  wait([&] { return !left.empty(); });
  EXPECT_EQ(ending_of("a"), "SUCCEEDED") << "its result came before";
}

TEST_F(LinkWorkerChangeTest, ListStopsAfterTheTargetThatIsOnTheWire) {
  start_list([this] { remove(0); }, 3);
  wait([&] { return !left.empty(); });
  EXPECT_EQ(ending_of("list"), "PARTIAL reloading");
  EXPECT_EQ(result_of("list")->progress, (Progress{3, 8}));
  const std::size_t so_far = of_device(1).size();
  wait([&] { return of_device(1).size() > so_far + 3; });
}

TEST_F(LinkWorkerChangeTest, OtherIntervalLeavesDeviceAndCommandsAsTheyAre) {
  config.devices[1].groups[0].interval = std::chrono::hours(1);
  start();
  wait([&] { return !of_device(0).empty() && !of_device(1).empty(); });
  wait_for_state(State::online, "", 1);
  states.clear();
  for (int i = 0; i < 5; ++i) submit(write_setpoint("c" + std::to_string(i), 50 + i, 1));
  DeviceConfig next = config.devices[1];
  next.groups[0].interval = milliseconds(2);
  worker->adjust(1, next);
  const std::size_t so_far = of_device(1).size();
  wait([&] { return of_device(1).size() >= so_far + 20; });
  for (int i = 0; i < 5; ++i) {
    const std::string id = "c" + std::to_string(i);
    EXPECT_EQ(ending_of(id), "SUCCEEDED") << id;
  }
  EXPECT_TRUE(states.empty());
  EXPECT_EQ(wire->opened(), 1U);
  for (std::size_t i = 1; i < of_device(1).size(); ++i)
    EXPECT_EQ(of_device(1)[i].seq, of_device(1)[i - 1].seq + 1);
}

TEST_F(LinkWorkerChangeTest, DeviceLeavesAtOnceWhereTheLineIsDown) {
  config.links[0].channel = TcpSettings{"192.0.2.10", 5551};
  script().refuse_open("away").refuse_open("away");
  start();
  wait([&] { return !telemetry.empty(); });
  remove(0);
  remove(1);
  wait([&] { return left.size() == 2; });
  const std::size_t so_far = telemetry.size();
  wait([&] { return wire->opened() >= 2; });
  EXPECT_EQ(telemetry.size(), so_far);
}

TEST_F(LinkWorkerChangeTest, StopInTheMiddleAnswersWhoWaitsForTheLeave) {
  script().then([&](ByteView request) {
    if (left.empty() && !removed && of_device(1).size() > 2) {
      removed = true;
      remove(1);
      asio::post(io, [this] { worker->stop(); });
    }
    return plc.answer(request);
  });
  start();
  wait([&] { return ended; });
  EXPECT_EQ(left.size(), 1U);
}

TEST_F(LinkWorkerTest, PortThatWasYieldedIsTakenBackWhenItsTimeIsOver) {
  config.devices[0].groups[0].interval = milliseconds(5);
  add_setpoint();
  start();
  wait_for_state(State::online, "");
  std::vector<Reason> told;
  const auto tell = [&](Reason why) { told.push_back(why); };
  worker->yield(std::chrono::steady_clock::now() + milliseconds(100), "for GX Works", tell);
  wait_for_state(State::yielded, "yielded");
  EXPECT_EQ(told, std::vector<Reason>{Reason::none});
  const std::size_t asked = plc.asked().size();
  submit(write_setpoint("b7e1"));
  wait([&] { return !results.empty(); });
  EXPECT_EQ(ending(results[0]), "REJECTED yielded");
  EXPECT_EQ(plc.asked().size(), asked);
  wait_for_state(State::online, "");
  EXPECT_GT(plc.asked().size(), asked);
}

// The scheduler still counted the command, and offered it from an empty queue.
TEST_F(LinkWorkerWithSetpoint, CommandThatWaitedWhenThePortWasYieldedIsForgotten) {
  start();
  wait_for_state(State::online, "");
  submit(write_setpoint("waits"));
  worker->yield(std::chrono::steady_clock::now() + milliseconds(50), "for GX Works", [](Reason) {});
  EXPECT_EQ(ending(wait_for_result("waits")), "REJECTED yielded");
  wait_for_state(State::yielded, "yielded");
  wait_for_state(State::online, "");
  submit(write_setpoint("b7e1"));
  EXPECT_EQ(wait_for_result("b7e1").status, CommandStatus::succeeded);
}

TEST_F(LinkWorkerTest, YieldThatIsNotAllowedAnyMoreEnds) {
  config.links[0].allow_yield = true;
  start();
  wait_for_state(State::online, "");
  worker->yield(SteadyTime::max(), "for GX Works", [](Reason) {});
  wait_for_state(State::yielded, "yielded");
  LinkConfig link = config.links[0];
  link.allow_yield = false;
  worker->adjust(link);
  wait_for_state(State::online, "");
}

TEST_F(LinkWorkerTest, YieldThatIsStoppedIsAnswered) {
  start();
  wait_for_state(State::online, "");
  std::vector<Reason> told;
  worker->yield(SteadyTime::max(), "for GX Works", [&](Reason why) { told.push_back(why); });
  stop();
  EXPECT_EQ(told.size(), 1U);
  worker->take_back([&](Reason why) { told.push_back(why); });
  EXPECT_EQ(told.back(), Reason::shutting_down);
}

}  // namespace
}  // namespace fxagent::test
