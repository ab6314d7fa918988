#include "agent/field/command/link_commands.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <stdexcept>

#include "agent/commands/result.h"
#include "agent/field/command/command_line_time.h"
#include "tests/agent/field/command/command_plant.h"
#include "tests/agent/field/fake_port.h"
#include "tests/agent/field/late_wire.h"
#include "tests/agent/field/port_frames.h"
#include "tests/support/scratch.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;

/// One link without its loop, at 1 ms per character: the test decides when the next command runs.
struct LinkCommandsTest : ScriptedBusTest {
  using Change = std::function<void(DeviceConfig&)>;
  explicit LinkCommandsTest(nanoseconds char_time = milliseconds(1), const Change& change = {}) {
    config.links.push_back({"line1", SerialSettings{}, char_time});
    DeviceConfig press = port_device();
    press.groups[0].interval = std::chrono::hours(1);
    for (int i = 0; i < 4; ++i)
      press.tags.push_back(
          writable(tag(*press.codec, "x" + std::to_string(i), "D" + std::to_string(200 + i))));
    press.tags.push_back(writable(tag(*press.codec, "wide", "D201", DataType::int32)));
    press.commands.allow_run_stop = true;
    if (change) change(press);
    config.devices.push_back(std::move(press));
    make_bus(char_time);
    wire->then([this](ByteView request) { return plc.answer(request); });
    const LinkParts link{config.links[0], 0, *bus, scheduler, devices, outbox};
    state = std::make_unique<LinkState>(link, 1);
    poller = std::make_unique<Poller>(link, *state);
    commands = std::make_unique<LinkCommands>(io.get_executor(), link, *state, *poller, recorder);
    devices.push_back(std::make_unique<LinkDevice>(config.devices.shared(0), 0));
    devices[0]->id = scheduler.add_device(3, {});
    poller->add_groups(*devices[0], nanoseconds(0));
  }

  /// Adds a command that writes 50, 51 … to x0, x1 …
  void add(std::string id, std::vector<int> tags) {
    Command command = command_of(std::move(id), Op::write);
    command.verify = false;
    command.is_list = tags.size() > 1;
    for (const int i : tags)
      command.targets.push_back(target_of("x" + std::to_string(i), number(50 + i)));
    submit(std::move(command));
  }
  void add_wide(std::string id) {
    Command command = command_of(std::move(id), Op::write, {target_of("wide", number(9))});
    command.verify = false;
    submit(std::move(command));
  }
  void add(std::string id, Op op) { submit(command_of(std::move(id), op)); }
  void submit(Command command) {
    LinkDevice& device = *devices[0];
    CommandAdmission admission(device.config);
    commands->add(admitted(admission, std::move(command), device.codec), device);
  }
  void run_next() { run_on(io, commands->run_next()); }
  /// Runs the next due poll. Returns false if none is due.
  bool poll() {
    const PollScheduler::Job job = scheduler.next(Clock::now());
    if (job.kind != PollScheduler::Job::Kind::poll) return false;
    run_on(io, poller->run(job.poll));
    return true;
  }
  /// Runs up to three polls until there is telemetry.
  bool polls_bring_telemetry() {
    for (int i = 0; i < 3 && telemetry.empty(); ++i) {
      EXPECT_TRUE(poll());
      collect();
    }
    return !telemetry.empty();
  }
  void open() {
    ScriptedBusTest::open();
    state->opened();
  }
  /// Opens the line, and lets the device answer a command.
  void be_online() {
    open();
    add("first", {1});
    run_next();
    EXPECT_EQ(outbox.take().states.size(), 1U);
  }
  /// Lets the PLC execute RUN and STOP too.
  void answer_run_and_stop() {
    wire->then([this](ByteView request) {
      for (const bool stop : {true, false})
        if (std::ranges::equal(request, force_frame(kForceM8037, stop))) {
          plc.set(kM8000, {static_cast<std::uint8_t>(stop ? 0 : 1)});
          return kAck;
        }
      return plc.answer(request);
    });
  }
  void collect() {
    Outbox::Batch batch = outbox.take();
    for (auto& result : batch.results) results.push_back(std::move(result));
    for (auto& message : batch.telemetry) telemetry.push_back(std::move(message));
  }

  using Ids = std::vector<std::string>;
  /// Runs the next command. Returns the ids of all results so far.
  Ids ended() {
    run_next();
    collect();
    Ids ids;
    for (const CommandResult& result : results) ids.push_back(result.id);
    return ids;
  }

  Config config;
  Outbox outbox{1000};
  PollScheduler scheduler;
  LinkDevices devices;
  FakePort plc;
  std::unique_ptr<LinkState> state;
  std::unique_ptr<Poller> poller;
  const LinkConfig of_recorder;  // it is off
  LinkRecorder recorder{nullptr, of_recorder, 0};
  std::unique_ptr<LinkCommands> commands;
  std::vector<CommandResult> results;
  std::vector<Telemetry> telemetry;
};

TEST_F(LinkCommandsTest, AnswerToACommandDoesNotEndTheRestAfterInvalidAnswers) {
  open();
  const PollScheduler::GroupId group = devices[0]->groups[0]->id;
  for (int i = 0; i < 3; ++i) scheduler.only_invalid(group, Clock::now() + std::chrono::hours(1));
  const auto due = Clock::now() + std::chrono::minutes(1);
  EXPECT_EQ(scheduler.next(due).kind, PollScheduler::Job::Kind::wait);
  add("a", {0});
  EXPECT_EQ(ended(), Ids{"a"});
  EXPECT_EQ(scheduler.next(due).kind, PollScheduler::Job::Kind::wait)
      << "with a write each second, a bad block would never rest";
}

TEST_F(LinkCommandsTest, CommandsGoInTheirOrderAndTellWhatTheyWrote) {
  add("a", {0});
  add("b", {1});
  EXPECT_EQ(scheduler.share().commands_waiting(), 2U);
  EXPECT_FALSE(commands->is_running());
  run_next();
  run_next();
  EXPECT_FALSE(commands->is_running());
  EXPECT_EQ(scheduler.share().commands_waiting(), 0U);
  collect();
  ASSERT_EQ(results.size(), 2U);
  EXPECT_EQ(results[0].id, "a");
  EXPECT_EQ(results[0].status, CommandStatus::succeeded);
  EXPECT_FALSE(results[0].frames.frames().empty());
  EXPECT_EQ(results[1].id, "b");
  ASSERT_EQ(telemetry.size(), 2U);
  EXPECT_TRUE(telemetry[0].written);
  EXPECT_EQ(telemetry[0].readings.at(0).value, number(50));
  EXPECT_EQ(plc.word_at(kD200), 50U);
}

TEST_F(LinkCommandsTest, BoundCountsWhatIsAhead) {
  for (const char* id : {"a", "b", "c"}) add(id, {0});
  const std::list<WaitingCommand>& waiting = commands->waiting();
  ASSERT_EQ(waiting.size(), 3U);
  std::vector<nanoseconds> bounds;
  for (const WaitingCommand& command : waiting) {
    ASSERT_TRUE(command.admitted.bound);
    bounds.push_back(*command.admitted.bound);
  }
  const nanoseconds own = waiting.front().line_time;
  EXPECT_GE(bounds[0], own + poller->longest_poll());
  EXPECT_GE(bounds[1], bounds[0] + own);
  EXPECT_GE(bounds[2], bounds[1] + own);
}

TEST_F(LinkCommandsTest, ShortOneGoesBetweenTheTargetsOfAList) {
  add("list", {0, 1, 2});
  add("short", {3});
  EXPECT_EQ(ended(), (Ids{"short", "list"}));
  EXPECT_EQ(scheduler.share().commands_waiting(), 0U);
}

TEST_F(LinkCommandsTest, OneThatMeetsAPlaceOfTheListWaitsForItsEnd) {
  add("list", {0, 1, 2});
  add("same", {2});
  EXPECT_EQ(ended(), Ids{"list"});
  EXPECT_EQ(scheduler.share().commands_waiting(), 1U);
}

TEST_F(LinkCommandsTest, OneThatMeetsAPlaceOfTheListInPartWaitsForItsEndToo) {
  add("list", {0, 1, 2, 3});
  add_wide("D201 and D202");
  EXPECT_EQ(ended(), Ids{"list"});
  EXPECT_EQ(scheduler.share().commands_waiting(), 1U);
}

TEST_F(LinkCommandsTest, NobodyGoesPastOneThatWaitsForTheEndOfTheList) {
  add("list", {2, 3, 0, 1});
  add("waits", {0, 1});
  add("short", {3});
  EXPECT_EQ(ended(), Ids{"list"});
  EXPECT_EQ(ended(), (Ids{"list", "short", "waits"})) << "between the targets of the other list";
}

TEST_F(LinkCommandsTest, OneWithinAnotherUsesNoMoreThanBothHaveUsed) {
  add("outer", {0, 0, 0, 0});
  add("inner", {1, 1});
  add("short", {2});
  EXPECT_EQ(ended(), (Ids{"inner", "short", "outer"}))
      << "not between the targets of the inner one";
}

TEST_F(LinkCommandsTest, OneWithinAnotherIsChargedToBoth) {
  int writes = 0;
  wire->then([&](ByteView request) {
    const bool is_write = request.size() > 11;
    if (is_write && ++writes == 3) {
      add("inner", {1, 1});
      add("short", {2});
      add("last", {3});
    }
    return plc.answer(request);
  });
  add("outer", {0, 0, 0, 0});
  EXPECT_EQ(ended(), (Ids{"short", "inner", "outer"}));
}

TEST_F(LinkCommandsTest, StopGoesBetweenTheTargetsOfALongList) {
  answer_run_and_stop();
  plc.set(kM8000, {1});
  add("list", std::vector<int>(60, 0));
  add("stop", Op::stop);
  ASSERT_EQ(ended(), (Ids{"stop", "list"}));
  EXPECT_EQ(results[0].status, CommandStatus::succeeded);
}

TEST_F(LinkCommandsTest, RunWaitsForTheEndOfTheListBeforeIt) {
  answer_run_and_stop();
  add("list", std::vector<int>(60, 0));
  add("run", Op::run);
  EXPECT_EQ(ended(), Ids{"list"});
}

TEST_F(LinkCommandsTest, RunStateIsWhatTheCommandHasMadeOfIt) {
  answer_run_and_stop();
  for (const bool run : {true, false}) {
    add("switch", run ? Op::run : Op::stop);
    run_next();
    EXPECT_EQ(devices[0]->state.reported().run, run);
  }
}

TEST_F(LinkCommandsTest, DeviceThatHasAcknowledgedIsNotSilentThoughItsReadBackIs) {
  for (const bool acknowledged : {true, false}) {
    devices[0]->id = scheduler.add_device(1, {});
    wire->expect(kEnq).give(kAck).expect(write_frame(kD200, word(50)));
    if (acknowledged) wire->give(kAck).expect(read_frame(kD200, 2));
    wire->silence();
    plc.silent = true;
    Command command = command_of("write", Op::write, {target_of("x0", number(50))});
    command.verify = true;
    submit(std::move(command));
    run_next();
    EXPECT_EQ(scheduler.device(devices[0]->id).is_silent(), !acknowledged);
    bus->close();
  }
}

struct TwoGroups : LinkCommandsTest {
  TwoGroups()
      : LinkCommandsTest(milliseconds(1), [](DeviceConfig& device) {
          device.groups = {group("a", milliseconds(0)), group("b", milliseconds(0))};
          for (TagConfig& tag : device.tags) tag.group = tag.name == "x3" ? 1 : 0;
        }) {}
};

TEST_F(TwoGroups, NoCycleIsPublishedTwiceWhereAListOpensTheLineAgain) {
  constexpr unsigned kD203 = kD200 + 6;
  scheduler.share().set_poll_share(0.9);
  plc.set(kD203, word(7));
  open();
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(poll());
  collect();
  // The connection breaks in the poll between the two targets; the second target opens it again.
  wire->expect(write_frame(kD200, word(50))).give(kAck).expect(read_frame(kD200, 6)).hang_up();
  add("list", {0, 1});
  run_next();
  EXPECT_EQ(wire->steps_left(), 0U) << "a poll went between";
  EXPECT_EQ(plc.word_at(kD201), 51U) << "and the list to its end";
  plc.set(kD203, word(8));
  collect();
  telemetry.clear();
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(poll());
  collect();
  for (const Telemetry& message : telemetry)
    for (const TagReading& reading : message.readings)
      if (reading.tag == 3 && !reading.bad) {
        EXPECT_EQ(reading.value, number(8));
      }
}

struct CycleOfTwoReads : LinkCommandsTest {
  CycleOfTwoReads()
      : LinkCommandsTest(milliseconds(1), [](DeviceConfig& device) {
          device.groups[0].interval = milliseconds(0);
          device.tags.push_back(tag(*device.codec, "far", "D300"));
        }) {}
};

TEST_F(CycleOfTwoReads, LinkLostInACommandTakesTheOldValueWithIt) {
  plc.set(kD200, word(7));
  open();
  EXPECT_TRUE(poll());
  wire->expect(write_frame(kD200, word(50))).hang_up();
  add("write", {0});
  run_next();
  plc.set(kD200, word(50));  // it has arrived
  open();
  ASSERT_TRUE(polls_bring_telemetry());
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(results[0].status, CommandStatus::unknown_outcome);
  EXPECT_EQ(telemetry[0].readings.at(0).value, number(50));
}

TEST_F(LinkCommandsTest, LinkLostInACommandIsOfflineForThatReason) {
  be_online();
  wire->expect(write_frame(kD200, word(50))).hang_up();
  add("write", {0});
  run_next();
  ASSERT_FALSE(bus->is_open());
  const std::vector<DeviceStatus> states = outbox.take().states;
  ASSERT_EQ(states.size(), 1U);
  EXPECT_EQ(states[0].reason, "link_down");
  EXPECT_EQ(states[0].reason_text, bus->channel().why_lost());
}

TEST_F(LinkCommandsTest, LinkThatAStopClosesUnderACommandIsNotLost) {
  be_online();
  wire->expect(write_frame(kD200, word(50))).call([this] {
    state->stop(Reason::shutting_down);
    commands->end();
    bus->close();
  });
  add("write", {0});
  run_next();
  EXPECT_TRUE(outbox.take().states.empty());
  EXPECT_TRUE(state->is_up());
}

TEST_F(CycleOfTwoReads, FaultInACommandTakesTheOldValueWithIt) {
  plc.set(kD200, word(7));
  open();
  EXPECT_TRUE(poll());
  wire->expect(write_frame(kD200, word(50))).call([] { throw std::logic_error("a bug"); });
  add("write", {0});
  EXPECT_THROW(run_next(), std::logic_error);
  commands->answer_running();
  plc.set(kD200, word(50));  // it has arrived
  bus->close();
  open();
  ASSERT_TRUE(polls_bring_telemetry());
  EXPECT_EQ(telemetry[0].readings.at(0).value, number(50));
}

/// A computer link, which writes a list in one frame. All words of the device have one value.
struct ListInOneFrame : LinkCommandsTest {
  ListInOneFrame()
      : LinkCommandsTest(milliseconds(1), [](DeviceConfig& device) {
          device.protocol = find_protocol("fx-computer-link");
          device.codec = codec_of("fx-computer-link", {{"model", std::string("FX2N")}});
          device.groups[0].interval = milliseconds(0);
          device.tags.push_back(tag(*device.codec, "far", "D900"));
        }) {
    scheduler.share().set_poll_share(0.9);
    wire->then([this](ByteView request) {
      const Question question = dialect.understand(request);
      if (question.kind == Question::Kind::none) return Bytes();
      if (question.kind == Question::Kind::read) return dialect.data(question, value);
      value = 50;
      return dialect.ack(question);
    });
    open();
    EXPECT_TRUE(poll());  // one of two reads, with the old value
    EXPECT_FALSE(scheduler.share().command_goes_first(true)) << "the polls' claim begins anew";
  }
  void run_list(bool verify) {
    Command command = command_of("list", Op::write);
    command.verify = verify;
    command.is_list = true;
    for (const char* tag : {"x0", "x1", "x2"})
      command.targets.push_back(target_of(tag, number(50)));
    submit(std::move(command));
    run_next();
    collect();
    ASSERT_EQ(results.size(), 1U);
    EXPECT_EQ(results[0].status, CommandStatus::succeeded);
    EXPECT_TRUE(results[0].one_frame);
  }
  const LinkDialect dialect{/*ends_with_cr_lf=*/false};
  unsigned value = 7;
};

TEST_F(ListInOneFrame, CycleThatEndsBetweenTheReadBacksHasNoOldValue) {
  run_list(/*verify=*/true);
  const auto whole = std::ranges::find(telemetry, false, &Telemetry::partial);
  ASSERT_NE(whole, telemetry.end()) << "no cycle has ended between";
  ASSERT_EQ(whole->readings.at(2).tag, 2U);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(whole->readings[i].value, number(50)) << i;
}

TEST_F(ListInOneFrame, NothingGoesBetweenTargetsThatAreNotReadBack) {
  run_list(/*verify=*/false);
  EXPECT_EQ(telemetry.size(), 3U);
  for (const Telemetry& message : telemetry) EXPECT_TRUE(message.partial);
}

struct CycleWithTheRunSwitch : LinkCommandsTest {
  CycleWithTheRunSwitch()
      : LinkCommandsTest(milliseconds(1), [](DeviceConfig& device) {
          device.groups[0].interval = milliseconds(0);
          device.tags = {tag(*device.codec, "switch", "M8037", DataType::boolean),
                         tag(*device.codec, "far", "D300")};
        }) {}
};

TEST_F(CycleWithTheRunSwitch, RunOrStopTakesTheOldStateOfTheSwitchWithIt) {
  constexpr unsigned kM8032 = kM8000 + 4;
  answer_run_and_stop();
  open();
  EXPECT_TRUE(poll());
  ASSERT_EQ(plc.asked().back(), "read 01E4 1") << "the switch, which is off";
  add("stop", Op::stop);
  run_next();
  plc.set(kM8032, {0x20});  // M8037 is on
  ASSERT_TRUE(polls_bring_telemetry());
  EXPECT_TRUE(std::get<bool>(telemetry[0].readings.at(0).value.items.at(0)));
}

TEST_F(LinkCommandsTest, FaultAnswersTheOneUnderWayAndTheOthersGoOnWaiting) {
  wire->call([] { throw std::logic_error("a bug"); });
  add("a", {0});
  add("b", {1});
  EXPECT_THROW(run_next(), std::logic_error);
  EXPECT_TRUE(commands->is_running());
  commands->answer_running();
  EXPECT_FALSE(commands->is_running());
  EXPECT_EQ(scheduler.share().commands_waiting(), 1U);
  collect();
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(results[0].id, "a");
  EXPECT_EQ(results[0].status, CommandStatus::unknown_outcome);
  EXPECT_EQ(results[0].detail, "a fault in the agent ended the link during the command");
  bus->close();
  run_next();
  collect();
  EXPECT_EQ(results.back().id, "b");
  EXPECT_EQ(results.back().status, CommandStatus::succeeded);
}

TEST_F(LinkCommandsTest, StopEndsAListAndNothingGoesBetween) {
  add("list", {0, 1, 2});
  add("short", {3});
  state->stop(Reason::shutting_down);
  run_next();
  collect();
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(results[0].reason, Reason::shutting_down);
  EXPECT_TRUE(plc.asked().empty());
}

TEST_F(LinkCommandsTest, ConflictRejectsTheWaitingCommandsUntilItIsOver) {
  add("list", {0, 1, 2});
  add("short", {3});
  outbox.set_conflict(true);
  run_next();
  collect();
  ASSERT_EQ(results.size(), 2U);
  for (const CommandResult& result : results) {
    EXPECT_EQ(result.status, CommandStatus::rejected) << result.id;
    EXPECT_EQ(result.reason, Reason::conflict) << result.id;
  }
  EXPECT_EQ(scheduler.share().commands_waiting(), 0U);
  EXPECT_TRUE(plc.asked().empty());
  outbox.set_conflict(false);
  add("after", {0});
  run_next();
  collect();
  EXPECT_EQ(results.back().status, CommandStatus::succeeded);
}

struct LineOfUnknownSpeed : LinkCommandsTest {
  LineOfUnknownSpeed() : LinkCommandsTest(nanoseconds(0)) {}
};

TEST_F(LineOfUnknownSpeed, HasNoBound) {
  add("a", {0});
  EXPECT_FALSE(commands->waiting().front().admitted.bound);
}

/// With a recorder, on a line so fast that every command exceeds its bound.
struct RecordedCommands : LinkCommandsTest {
  RecordedCommands()
      : LinkCommandsTest(nanoseconds(1),
                         [](DeviceConfig& device) { device.turnaround = milliseconds(0); }) {
    files = std::make_unique<FlightRecorder>(
        FlightRecorder::Settings{.directory = scratch.path("recordings"),
                                 .most_files = 10,
                                 .most_bytes = 1 << 20,
                                 .follows = std::chrono::hours(1)});
    recording =
        std::make_unique<LinkRecorder>(files.get(), config.links[0], FrameRing::kLeastBytes);
    commands = std::make_unique<LinkCommands>(
        io.get_executor(), LinkParts{config.links[0], 0, *bus, scheduler, devices, outbox}, *state,
        *poller, *recording);
  }
  /// Ends the recorder. Returns true if it has written a file.
  bool has_recorded() {
    files.reset();
    for (const auto& entry : std::filesystem::directory_iterator(scratch.path("recordings")))
      if (entry.path().extension() == kRecordingSuffix) return true;
    return false;
  }

  const Scratch scratch;
  std::unique_ptr<FlightRecorder> files;
  std::unique_ptr<LinkRecorder> recording;
};

TEST_F(RecordedCommands, OneOverItsBoundIsAnAnomaly) {
  open();
  add("write", {0});
  run_next();
  EXPECT_TRUE(has_recorded());
}

TEST_F(RecordedCommands, OneThatWaitedForTheOpeningIsNone) {
  add("write", {0});
  open();
  run_next();
  bus->close();
  add("opens it", {0});
  run_next();
  wire->refuse_open("no such device");
  bus->close();
  add("does not open it", {0});
  run_next();
  EXPECT_FALSE(has_recorded());
}

TEST_F(LinkCommandsTest, ReadsAreThoseThatTheBoundCounts) {
  std::vector<Bytes> asked;
  wire->then([&](ByteView request) {
    asked.emplace_back(request.begin(), request.end());
    return plc.answer(request);
  });
  const auto add_read = [this](std::string id) {
    Command command =
        command_of(std::move(id), Op::read, {{"", "D201", std::nullopt, std::nullopt}});
    command.targets[0].count = 8;
    command.any_address = true;
    submit(std::move(command));
  };
  add_read("before");
  // Polls find that the device answers four words at most.
  const Span wide = *span_of(devices[0]->config.tags.back().point);
  const std::uint32_t half = wide.first_bit + 64;
  HoleMap& holes = devices[0]->found_holes();
  holes.refused({wide.space, wide.first_bit, 128}, Halves{half, half}, SteadyTime{});
  holes.read({wide.space, wide.first_bit, 64});
  holes.read({wide.space, half, 64});
  add_read("after");
  run_next();
  EXPECT_EQ(asked.back(), read_frame(kD200 + 2, 16));
  asked.clear();
  run_next();
  EXPECT_EQ(asked, (std::vector{read_frame(kD200 + 2, 8), read_frame(kD200 + 10, 8)}));
  asked.clear();
  holes.retry(SteadyTime{});
  holes.retry(SteadyTime{} + std::chrono::minutes(10));
  EXPECT_TRUE(holes.holes().limits.empty());
  add_read("later");
  run_next();
  EXPECT_EQ(asked.front(), read_frame(kD200 + 2, 8)) << "the limit is on trial with polls only";
}

/// The only device is all units of a Modbus line.
struct CommandsForAllUnits : LinkCommandsTest {
  CommandsForAllUnits()
      : LinkCommandsTest(milliseconds(1), [](DeviceConfig& all) {
          all.protocol = find_protocol("modbus-rtu");
          all.codec = codec_of("modbus-rtu", {{"unit", std::int64_t{0}}});
          all.tags = {writable(tag(*all.codec, "x0", "hr:200"))};
        }) {}
  nanoseconds newest_bound() const { return *commands->waiting().back().admitted.bound; }
};

TEST_F(CommandsForAllUnits, BoundCountsThePauseAfterThoseThatWereSent) {
  wire->expect(*from_hex("00 06 00C8 0032 8830"));
  add("first", {0});
  const nanoseconds first = newest_bound();
  const SteadyTime sent_after = Clock::now();
  run_next();
  const SteadyTime until = bus->not_before();
  EXPECT_GE(until - sent_after, milliseconds(100));
  const SteadyTime before = Clock::now();
  add("second", {0});
  const auto left = [&](SteadyTime now) { return std::max(until - now, nanoseconds(0)); };
  EXPECT_LE(newest_bound() - first, left(before));
  EXPECT_GE(newest_bound() - first, left(Clock::now()));
}

}  // namespace
}  // namespace fxagent::test
