#include "agent/field/command/command_execution.h"

#include <gtest/gtest.h>

#include "agent/commands/result.h"
#include "agent/field/command/command_line_time.h"
#include "tests/agent/field/command/command_plant.h"
#include "tests/agent/field/fake_port.h"
#include "tests/agent/field/port_frames.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using std::chrono::seconds;
using Clock = std::chrono::steady_clock;

const Bytes kWrite50 = write_frame(kD200, word(50));
constexpr unsigned kD250 = 0x11F4;
constexpr unsigned kD260 = 0x1208;
const Bytes kReadBack = read_frame(kD200, 2);
const Bytes kForceOn = force_frame(kForceM100, true);
const Bytes kReadM96 = read_frame(kM96, 1);
const Bytes kM100On = data_frame({0x10});
const Bytes kM100Off = data_frame({0x00});
const Bytes kProbe = read_frame(kM8000, 1);
const Bytes kRunning = data_frame({0x01});
const Bytes kStopped = data_frame({0x00});
const Bytes kStop = force_frame(kForceM8037, true);
const Bytes kRun = force_frame(kForceM8037, false);

/// One open line with a PLC that has answered its enquiry; commands pass through real admission.
struct CommandExecutionTest : CommandBusTest {
  CommandExecutionTest() : CommandBusTest(port_device()) {
    const Codec& codec = *device.codec;
    device.tags.push_back(writable(tag(codec, "setpoint", "D200")));
    device.tags.push_back(writable(tag(codec, "start", "M100")));
    device.tags.push_back(writable(array_of(tag(codec, "recipe", "D300"), 50)));
    device.tags.push_back(writable(tag(codec, "name", "D250", DataType::string)));
    device.tags.back().point.length = 3;
    device.tags.push_back(writable(tag(codec, "level", "D260", DataType::float32)));
    device.tags.push_back(tag(codec, "temp", "D100"));
    device.tags.push_back(tag(codec, "flow", "D100", DataType::float32));
    device.commands.allow_run_stop = true;
    make_bus();
    station.codec = device.codec;
    wire->expect(kEnq).give(kAck);
  }

  Command command(Op op, CommandTarget target = {}) {
    Command out = command_of("b7e1", op);
    if (!target.tag.empty()) out.targets.push_back(std::move(target));
    out.received = Clock::now();
    out.received_ms = 1790000000000;
    return out;
  }
  Command write(std::string tag, Value value) {
    return command(Op::write, target_of(std::move(tag), std::move(value)));
  }
  Command write_50() { return write("setpoint", number(50)); }
  Command write_50_unverified() {
    Command out = write_50();
    out.verify = false;
    return out;
  }
  Command write_50_expecting(Value there) {
    Command out = write_50();
    out.expect = std::move(there);
    return out;
  }
  Command force_on() { return command(Op::force_on, target_of("start")); }
  Command read(std::string tag) { return command(Op::read, target_of(std::move(tag))); }

  using CommandBusTest::run;
  CommandResult run(Command command) {
    AdmittedCommand each = admitted(admission, std::move(command), device.codec);
    if (before_sending) before_sending(each);
    return run(each);
  }
  CommandResult run_interrupted(Command command) {
    auto admitted = admission.interrupted(std::move(command), device.codec, Clock::now());
    if (admitted) return run(*admitted);
    ADD_FAILURE() << "nothing is to be read";
    return {};
  }
  CommandAdmission admission{device};
  std::function<void(AdmittedCommand&)> before_sending;
};

// ---- writes of words ---------------------------------------------------------------------------

TEST_F(CommandExecutionTest, WriteIsVerifiedByReadingBack) {
  wire->expect(kWrite50).give(kAck).expect(kReadBack).give(word_frame(50));
  const CommandResult result = run(write_50());
  EXPECT_EQ(ending(result), "SUCCEEDED");
  EXPECT_EQ(result.plc, PlcAnswer::ack);
  EXPECT_EQ(result.attempts, 1);
  ASSERT_EQ(result.targets.size(), 1U);
  const TargetResult& target = result.targets[0];
  EXPECT_EQ(target.tag, "setpoint");
  EXPECT_EQ(target.address, "D200");
  EXPECT_EQ(target.value, number(50));
  ASSERT_TRUE(target.verify);
  EXPECT_TRUE(target.verify->match);
  EXPECT_EQ(target.verify->read, number(50));
  EXPECT_GE(result.queue.count(), 0);
  EXPECT_GT(result.wire.count(), 0);
  EXPECT_TRUE(was_answered);
}

TEST_F(CommandExecutionTest, WriteWithoutVerifyIsOneExchange) {
  wire->expect(kWrite50).give(kAck);
  const CommandResult result = run(write_50_unverified());
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_FALSE(result.targets[0].verify);
}

TEST_F(CommandExecutionTest, OtherValueReadBackIsAMismatch) {
  wire->expect(kWrite50).give(kAck).expect(kReadBack).give(word_frame(49));
  const CommandResult result = run(write_50());
  EXPECT_EQ(ending(result), "FAILED verify_mismatch");
  EXPECT_NE(result.detail.find("did not take the value or limited it"), std::string::npos)
      << result.detail;
  EXPECT_EQ(result.plc, PlcAnswer::ack) << "it was carried out";
  ASSERT_TRUE(result.targets[0].verify);
  EXPECT_FALSE(result.targets[0].verify->match);
  EXPECT_EQ(result.targets[0].verify->read, number(49));
}

TEST_F(CommandExecutionTest, AcknowledgedWriteThatCannotBeReadBackSucceeded) {
  wire->expect(kWrite50).give(kAck).expect(kReadBack).silence();
  const CommandResult result = run(write_50());
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.plc, PlcAnswer::ack);
  EXPECT_FALSE(result.targets[0].verify);
  EXPECT_FALSE(result.detail.empty());
}

TEST_F(CommandExecutionTest, RefusedWriteIsSentASecondTime) {
  wire->expect(kWrite50).give(kNak).expect(kWrite50).give(kAck);
  wire->expect(kReadBack).give(word_frame(50));
  const CommandResult result = run(write_50());
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.plc, PlcAnswer::ack);
  EXPECT_EQ(result.attempts, 2);
}

TEST_F(CommandExecutionTest, WriteRefusedTwiceFailed) {
  wire->expect(kWrite50).give(kNak).expect(kWrite50).give(kNak);
  const CommandResult result = run(write_50());
  EXPECT_EQ(ending(result), "FAILED nak");
  EXPECT_EQ(result.plc, PlcAnswer::nak);
  EXPECT_EQ(result.attempts, 2) << "never a third time";
  EXPECT_FALSE(result.detail.empty());
  EXPECT_TRUE(was_answered);
}

TEST_F(CommandExecutionTest, SilenceAfterARefusalIsUnknownAndNotRepeated) {
  wire->expect(kWrite50).give(kNak).expect(kWrite50).silence();
  wire->expect(kEnq).silence();
  const CommandResult result = run(write_50());
  EXPECT_EQ(result.status, CommandStatus::unknown_outcome);
  EXPECT_EQ(result.plc, PlcAnswer::none);
  EXPECT_EQ(result.attempts, 2);
}

TEST_F(CommandExecutionTest, SecondTryIsInsideTheExpiryOnly) {
  AdmittedCommand* on_the_wire = nullptr;
  before_sending = [&](AdmittedCommand& admitted) { on_the_wire = &admitted; };
  wire->expect(kWrite50);
  wire->call([&] { on_the_wire->deadline = Clock::now() - milliseconds(1); });
  wire->give(kNak);
  const CommandResult result = run(write_50());
  EXPECT_EQ(ending(result), "FAILED nak");
  EXPECT_EQ(result.attempts, 1);
}

TEST_F(CommandExecutionTest, SilenceIsSettledByReadingBackEqual) {
  wire->expect(kWrite50).silence();
  wire->expect(kEnq).give(kAck).expect(kProbe).give(kRunning);
  wire->expect(kReadBack).give(word_frame(50));
  const CommandResult result = run(write_50_unverified());
  EXPECT_EQ(ending(result), "SUCCEEDED");
  EXPECT_EQ(result.plc, PlcAnswer::none);
  ASSERT_TRUE(result.targets[0].verify);
  EXPECT_TRUE(result.targets[0].verify->match);
  EXPECT_EQ(result.attempts, 1);
  EXPECT_EQ(result.detail, "no answer, but the value read back is the one to be written");
}

TEST_F(CommandExecutionTest, CutAnswerIsNotToldAsSilence) {
  wire->expect(kWrite50).give({0x02}).silence();
  wire->expect(kEnq).give(kAck).expect(kProbe).give(kRunning);
  wire->expect(kReadBack).give(word_frame(50));
  const std::string detail = run(write_50_unverified()).detail;
  EXPECT_TRUE(detail.starts_with("no valid answer (")) << detail;
  EXPECT_NE(detail.find("these bytes are not one: 02"), std::string::npos) << detail;
  EXPECT_TRUE(detail.ends_with("), but the value read back is the one to be written")) << detail;
}

TEST_F(CommandExecutionTest, SilenceAndAnotherValueIsUnknown) {
  wire->expect(kWrite50).silence();
  wire->expect(kEnq).give(kAck).expect(kProbe).give(kRunning);
  wire->expect(kReadBack).give(word_frame(49));
  const CommandResult result = run(write_50());
  EXPECT_EQ(ending(result), "UNKNOWN_OUTCOME timeout");
  EXPECT_EQ(result.plc, PlcAnswer::none);
  ASSERT_TRUE(result.targets[0].verify);
  EXPECT_FALSE(result.targets[0].verify->match);
  EXPECT_EQ(result.targets[0].verify->read, number(49));
}

TEST_F(CommandExecutionTest, SilenceThatLastsIsUnknown) {
  wire->expect(kWrite50).silence();
  wire->expect(kEnq).silence();
  const CommandResult result = run(write_50());
  EXPECT_EQ(ending(result), "UNKNOWN_OUTCOME timeout");
  EXPECT_FALSE(result.targets[0].verify);
  EXPECT_TRUE(was_unanswered);
  EXPECT_FALSE(was_answered);
}

TEST_F(CommandExecutionTest, NonsenseInsteadOfAnAckIsSettledLikeSilence) {
  wire->expect(kWrite50).give(joined({0x02}, Bytes(600, 0x30)));
  wire->discard_input();
  wire->expect(kEnq).give(kAck).expect(kProbe).give(kRunning);
  wire->expect(kReadBack).give(word_frame(50));
  const CommandResult result = run(write_50());
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.plc, PlcAnswer::none);
  EXPECT_EQ(result.attempts, 1);
  EXPECT_TRUE(result.detail.starts_with("no valid answer (")) << result.detail;
}

// The ACK was a late one; the NAK after it is the PLC's real answer to this write.
TEST_F(CommandExecutionTest, AckWithAnotherAnswerBehindItAndAnotherValueIsNoVerifyMismatch) {
  Bytes late_nak_first = kNak;
  const Bytes read_back = word_frame(45);
  late_nak_first.insert(late_nak_first.end(), read_back.begin(), read_back.end());
  wire->expect(kWrite50).give(kAck).expect(kReadBack).give(late_nak_first);
  FakePort plc;
  plc.set(kD200, word(45));
  wire->then([&plc](ByteView request) { return plc.answer(request); });
  const CommandResult result = run(write_50());
  EXPECT_EQ(ending(result), "UNKNOWN_OUTCOME bad_frame");
  EXPECT_EQ(result.plc, PlcAnswer::none);
  ASSERT_TRUE(result.targets.at(0).verify);
  EXPECT_EQ(result.targets[0].verify->read, number(45));
}

// ---- the record a crash would leave ------------------------------------------------------------

/// Records the commands marked as sent, and the number of frames on the line at that time.
class Marks final : public CommandStarts {
 public:
  explicit Marks(const ScriptedTransport& wire) : wire_(wire) {}
  void mark(std::uint64_t number, Done done) override {
    numbers.push_back(number);
    frames_before.push_back(wire_.written().size());
    if (meanwhile) meanwhile();
    done(disk_answers);
  }

  bool disk_answers = true;
  std::function<void()> meanwhile{};
  std::vector<std::uint64_t> numbers;
  std::vector<std::size_t> frames_before;

 private:
  const ScriptedTransport& wire_;
};

struct CommandExecutionMarks : CommandExecutionTest {
  CommandExecutionMarks() {
    before_sending = [this](AdmittedCommand& admitted) {
      admitted.command.number = 7;
      admitted.starts = &marks;
    };
  }
  void TearDown() override {
    for (const std::uint64_t number : marks.numbers) EXPECT_EQ(number, 7U);
  }
  Marks marks{*wire};
};

TEST_F(CommandExecutionMarks, WriteIsMarkedOnceBeforeItsFirstByteHoweverOftenItIsSent) {
  wire->expect(kWrite50).give(kNak).expect(kWrite50).give(kAck);
  wire->expect(kReadBack).give(word_frame(50));
  EXPECT_EQ(run(write_50()).status, CommandStatus::succeeded);
  EXPECT_EQ(marks.frames_before, (std::vector<std::size_t>{0}));
}

TEST_F(CommandExecutionMarks, ReadForExpectIsNoStart) {
  wire->expect(kReadBack).give(word_frame(45));
  wire->expect(kWrite50).give(kAck).expect(kReadBack).give(word_frame(50));
  EXPECT_EQ(run(write_50_expecting(number(45))).status, CommandStatus::succeeded);
  EXPECT_EQ(marks.frames_before, (std::vector<std::size_t>{2}))
      << "behind the enquiry and the read";
}

TEST_F(CommandExecutionMarks, CommandThatIsNotSentIsNotMarked) {
  wire->expect(kReadBack).give(word_frame(46));
  EXPECT_EQ(run(write_50_expecting(number(45))).reason, Reason::expect_mismatch);
  EXPECT_TRUE(marks.numbers.empty());
}

TEST_F(CommandExecutionMarks, ReadIsNotMarked) {
  wire->expect(read_frame(kD100, 2)).give(word_frame(7));
  EXPECT_EQ(run(read("temp")).status, CommandStatus::succeeded);
  EXPECT_TRUE(marks.numbers.empty());
}

TEST_F(CommandExecutionMarks, CommandOfALinkThatDoesNotOpenIsNotMarked) {
  wire->skip();  // the enquiry
  wire->skip();  // and its answer
  wire->refuse_open("no such device");
  EXPECT_EQ(run(write_50()).reason, Reason::link_down);
  EXPECT_TRUE(marks.numbers.empty());
}

TEST_F(CommandExecutionMarks, CommandThatCannotBeMarkedIsNotSent) {
  wire->skip();  // the enquiry
  wire->skip();  // and its answer
  marks.disk_answers = false;
  const CommandResult result = run(write_50());
  EXPECT_EQ(ending(result), "FAILED store_unavailable");
  EXPECT_NE(result.detail.find("nothing was sent"), std::string::npos) << result.detail;
  EXPECT_EQ(result.attempts, 0);
  EXPECT_TRUE(wire->written().empty());
}

TEST_F(CommandExecutionMarks, NothingIsWrittenAfterAStopDuringTheMark) {
  wire->skip();  // the enquiry
  wire->skip();  // and its answer
  marks.meanwhile = [this] { others.stopping = true; };
  EXPECT_EQ(ending(run(write_50())), "FAILED shutting_down");
  EXPECT_TRUE(wire->written().empty());
}

TEST_F(CommandExecutionMarks, StopIsMarkedBeforeItLeaves) {
  wire->expect(kStop).give(kAck).expect(kProbe).give(kStopped);
  EXPECT_EQ(run(command(Op::stop)).status, CommandStatus::succeeded);
  EXPECT_EQ(marks.frames_before, (std::vector<std::size_t>{0}));
}

// ---- records of an earlier run -----------------------------------------------------------------

TEST_F(CommandExecutionTest, InterruptedCommandIsReadAndNotSent) {
  wire->expect(kReadBack).give(word_frame(50));
  const CommandResult result = run_interrupted(write_50());
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.plc, PlcAnswer::none);
  EXPECT_EQ(result.attempts, 0);
  ASSERT_TRUE(result.targets.at(0).verify);
  EXPECT_TRUE(result.targets[0].verify->match);
}

TEST_F(CommandExecutionTest, InterruptedCommandAndAnotherValueIsUnknown) {
  wire->expect(kReadBack).give(word_frame(7));
  const CommandResult result = run_interrupted(write_50());
  EXPECT_EQ(ending(result), "UNKNOWN_OUTCOME interrupted");
  EXPECT_EQ(result.detail, kInterrupted);
  EXPECT_EQ(result.targets.at(0).verify->read, number(7));
  EXPECT_FALSE(result.targets[0].verify->match);
}

TEST_F(CommandExecutionTest, InterruptedCommandThatCannotBeReadIsUnknown) {
  wire->expect(kReadBack).silence();
  const CommandResult result = run_interrupted(write_50());
  EXPECT_EQ(ending(result), "UNKNOWN_OUTCOME interrupted");
  EXPECT_FALSE(result.targets.at(0).verify);
}

TEST_F(CommandExecutionTest, LongWriteGoesInSeveralFramesAndIsReadBackWhole) {
  // 100 bytes: the port takes 64 per frame.
  Bytes first(64, 0);
  Bytes rest(36, 0);
  Scalars items;
  for (std::int64_t i = 0; i < 50; ++i) {
    items.emplace_back(i);
    (i < 32 ? first[static_cast<std::size_t>(2 * i)] : rest[static_cast<std::size_t>(2 * i - 64)]) =
        static_cast<std::uint8_t>(i);
  }
  const unsigned d300 = 0x1000 + 600;
  wire->expect(write_frame(d300, first)).give(kAck);
  wire->expect(write_frame(d300 + 64, rest)).give(kAck);
  FakePort plc;
  plc.set(d300, joined(first, rest));
  wire->then([&](ByteView request) { return plc.answer(request); });
  const CommandResult result = run(write("recipe", Value::array(items)));
  EXPECT_EQ(result.status, CommandStatus::succeeded) << result.detail;
  EXPECT_EQ(result.attempts, 2);
  EXPECT_EQ(result.targets[0].verify.value_or(Verification{}).read, Value::array(items));
}

// ---- bits --------------------------------------------------------------------------------------

TEST_F(CommandExecutionTest, ForceIsNotVerifiedUnlessAsked) {
  wire->expect(kForceOn).give(kAck);
  const CommandResult result = run(force_on());
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_FALSE(result.targets[0].verify) << "a ladder resets what an operator sets";
}

TEST_F(CommandExecutionTest, ForceIsVerifiedWhereTheCommandSaysSo) {
  wire->expect(kForceOn).give(kAck).expect(kReadM96).give(kM100Off);
  Command command = force_on();
  command.verify = true;
  const CommandResult result = run(std::move(command));
  EXPECT_EQ(ending(result), "FAILED verify_mismatch");
  EXPECT_EQ(result.targets[0].verify.value_or(Verification{}).read, flag(false));
}

TEST_F(CommandExecutionTest, SilentForceIsSettledByReadingTheBit) {
  wire->expect(kForceOn).silence();
  wire->expect(kEnq).give(kAck).expect(kProbe).give(kRunning);
  wire->expect(kReadM96).give(kM100On);
  EXPECT_EQ(run(force_on()).status, CommandStatus::succeeded);
}

TEST_F(CommandExecutionTest, SilentForceOfABitThatIsNotSetIsUnknown) {
  wire->expect(kForceOn).silence();
  wire->expect(kEnq).give(kAck).expect(kProbe).give(kRunning);
  wire->expect(kReadM96).give(kM100Off);
  const CommandResult result = run(force_on());
  EXPECT_EQ(ending(result), "UNKNOWN_OUTCOME timeout");
  EXPECT_EQ(result.attempts, 1) << "a force is never repeated after silence";
}

// ---- several exchanges -------------------------------------------------------------------------

Bytes words_up_from(unsigned first, unsigned count) {
  Bytes out;
  for (unsigned i = 0; i < count; ++i) out = joined(out, word(first + i));
  return out;
}

struct RecipeTest : CommandExecutionTest {
  /// D300 … D349 become 1 … 50, in two frames.
  Command recipe() {
    Scalars items;
    for (std::int64_t i = 1; i <= 50; ++i) items.emplace_back(i);
    Command out = write("recipe", Value::array(std::move(items)));
    out.verify = false;
    return out;
  }
  static constexpr unsigned kD300 = 0x1258;
  const Bytes first = write_frame(kD300, words_up_from(1, 32));
  const Bytes second = write_frame(kD300 + 64, words_up_from(33, 18));
  void read_back(unsigned written) {
    Bytes there = joined(words_up_from(1, written), Bytes(2 * (50 - written)));
    wire->expect(read_frame(kD300, 36)).give(data_frame(Bytes(there.begin(), there.begin() + 36)));
    wire->expect(read_frame(kD300 + 36, 64))
        .give(data_frame(Bytes(there.begin() + 36, there.end())));
  }
};

TEST_F(RecipeTest, ArrayWhoseSecondFrameIsRefusedIsPartial) {
  wire->expect(first).give(kAck).expect(second).give(kNak).expect(second).give(kNak);
  read_back(32);
  const CommandResult result = run(recipe());
  EXPECT_EQ(ending(result), "PARTIAL nak");
  EXPECT_EQ(result.plc, PlcAnswer::nak);
  EXPECT_EQ(result.progress, (Progress{32, 50}));
  ASSERT_TRUE(result.targets[0].verify && result.targets[0].verify->read);
  EXPECT_FALSE(result.targets[0].verify->match);
  EXPECT_EQ(result.targets[0].verify->read->items[31], Scalar(std::int64_t{32}));
  EXPECT_EQ(result.targets[0].verify->read->items[32], Scalar(std::int64_t{0}));
}

TEST_F(RecipeTest, OneFrameOfAnArrayIsRepeatedAndNoMore) {
  wire->expect(first).give(kNak).expect(first).give(kAck).expect(second).give(kNak);
  read_back(32);
  const CommandResult result = run(recipe());
  EXPECT_EQ(ending(result), "PARTIAL nak");
  EXPECT_EQ(result.progress, (Progress{32, 50}));
}

TEST_F(RecipeTest, ArrayUnderWayIsFinishedThoughItsTimePasses) {
  AdmittedCommand* on_the_wire = nullptr;
  before_sending = [&](AdmittedCommand& admitted) { on_the_wire = &admitted; };
  wire->expect(first);
  wire->call([&] { on_the_wire->deadline = Clock::now() - milliseconds(1); });
  wire->give(kAck).expect(second).give(kAck);
  const CommandResult result = run(recipe());
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_FALSE(result.progress);
}

TEST_F(RecipeTest, SilenceOnTheSecondFrameIsUnknownAndTellsWhatIsSure) {
  wire->expect(first).give(kAck).expect(second).silence();
  wire->expect(kEnq).give(kAck).expect(kProbe).give(kRunning);
  read_back(32);
  const CommandResult result = run(recipe());
  EXPECT_EQ(ending(result), "UNKNOWN_OUTCOME timeout");
  EXPECT_EQ(result.progress, (Progress{32, 50}));
}

TEST_F(CommandExecutionTest, CommandThatDoesNotFitIntoItsTimeIsNotBegun) {
  before_sending = [](AdmittedCommand& admitted) {
    admitted.line_time = seconds(20);
    admitted.deadline = Clock::now() + seconds(5);
  };
  const CommandResult result = run(write_50());
  EXPECT_EQ(result.status, CommandStatus::expired);
  EXPECT_NE(result.detail.find("20000 ms"), std::string::npos) << result.detail;
  EXPECT_TRUE(wire->written().empty());
  wire->expect(kWrite50).give(kAck);
  before_sending = [](AdmittedCommand& admitted) {
    admitted.line_time = seconds(20);
    admitted.deadline = Clock::now() + seconds(60);
  };
  Command command = write_50();
  command.id = "b7e2";
  command.verify = false;
  EXPECT_EQ(run(command).status, CommandStatus::succeeded);
}

// ---- broken connections, absent devices --------------------------------------------------------

TEST_F(CommandExecutionTest, LinkLostAfterTheFirstByteIsUnknown) {
  wire->expect(kWrite50).hang_up();
  const CommandResult result = run(write_50());
  EXPECT_EQ(ending(result), "UNKNOWN_OUTCOME link_down");
  EXPECT_EQ(result.attempts, 1);
}

TEST_F(CommandExecutionTest, HalfAFrameIsUnknownToo) {
  wire->break_write(3);
  EXPECT_EQ(ending(run(write_50())), "UNKNOWN_OUTCOME link_down");
}

TEST_F(CommandExecutionTest, LinkFoundDeadBeforeTheFirstByteIsOpenedAnewOnce) {
  wire->expect(kWrite50).give(kAck).hang_up();
  wire->expect(kEnq).give(kAck).expect(kWrite50).give(kAck);
  Command first = write_50();
  first.verify = false;
  EXPECT_EQ(run(first).status, CommandStatus::succeeded);
  Command second = first;
  second.id = "b7e2";
  const CommandResult result = run(second);
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.attempts, 1);
  EXPECT_EQ(wire->opened(), 2U);
}

TEST_F(CommandExecutionTest, ClosedLinkIsOpenedForTheCommand) {
  wire->expect(kWrite50).give(kAck);
  ASSERT_FALSE(bus->is_open());
  EXPECT_EQ(run(write_50_unverified()).status, CommandStatus::succeeded);
  EXPECT_EQ(wire->opened(), 1U);
}

struct CommandExecutionWithoutLink : CommandExecutionTest {
  CommandExecutionWithoutLink() {
    wire->discard_input();
    make_bus();
  }
};

TEST_F(CommandExecutionWithoutLink, LinkThatWillNotOpenFailsAfterOneAttempt) {
  wire->refuse_open("no such adapter");
  const CommandResult result = run(write_50());
  EXPECT_EQ(ending(result), "FAILED link_down");
  EXPECT_EQ(result.plc, PlcAnswer::none);
  EXPECT_EQ(result.detail, "no such adapter");
  EXPECT_EQ(result.attempts, 0);
  EXPECT_EQ(wire->opened(), 1U);
}

TEST_F(CommandExecutionWithoutLink, ReadOverALinkThatWillNotOpenWasNeverSent) {
  wire->refuse_open("no such adapter");
  const CommandResult result = run(read("temp"));
  EXPECT_EQ(ending(result), "FAILED link_down");
  EXPECT_EQ(result.attempts, 0);
}

TEST_F(CommandExecutionWithoutLink, ExpiredCommandIsExpiredWhateverTheLink) {
  before_sending = [](AdmittedCommand& admitted) {
    admitted.deadline = Clock::now() - milliseconds(1);
  };
  EXPECT_EQ(ending(run(write_50())), "EXPIRED expired");
  EXPECT_EQ(wire->opened(), 0U) << "nobody waits for a link that nothing will be sent on";
}

TEST_F(CommandExecutionWithoutLink, DeviceThatDoesNotAnswerItsEnquiryIsOffline) {
  wire->expect(kEnq).silence();
  const CommandResult result = run(write_50());
  EXPECT_EQ(ending(result), "FAILED device_offline") << "the command itself never left";
  EXPECT_EQ(result.attempts, 0);
  EXPECT_TRUE(was_unanswered);
}

TEST_F(CommandExecutionTest, CommandThatExpiredInTheQueueIsNotSent) {
  wire->expect(kForceOn).give(kAck);
  run(force_on());
  before_sending = [](AdmittedCommand& admitted) {
    admitted.deadline = Clock::now() - milliseconds(1);
  };
  Command late = write_50();
  late.id = "b7e2";
  const CommandResult result = run(late);
  EXPECT_EQ(ending(result), "EXPIRED expired");
  EXPECT_EQ(result.attempts, 0);
}

// ---- expect ------------------------------------------------------------------------------------

TEST_F(CommandExecutionTest, ExpectedValueIsReadFirst) {
  wire->expect(kReadBack).give(word_frame(45)).expect(kWrite50).give(kAck);
  wire->expect(kReadBack).give(word_frame(50));
  EXPECT_EQ(run(write_50_expecting(number(45))).status, CommandStatus::succeeded);
}

TEST_F(CommandExecutionTest, ExpectedTextIsThatOfItsCharacters) {
  const Bytes read = read_frame(kD250, 4);
  wire->expect(read).give(data_frame({'A', 0, 'x', 'y'}));
  wire->expect(write_frame(kD250, Bytes{'B', 0, 0, 'y'})).give(kAck);
  wire->expect(read).give(data_frame({'B', 0, 0, 'y'}));
  Command command = write("name", text("B"));
  command.expect = text("A");
  EXPECT_EQ(run(std::move(command)).status, CommandStatus::succeeded);
}

TEST_F(CommandExecutionTest, MinusZeroIsTheZeroThatIsExpected) {
  const Bytes read = read_frame(kD260, 4);
  wire->expect(read).give(data_frame({0, 0, 0, 0x80}));
  wire->expect(write_frame(kD260, Bytes{0, 0, 0xC0, 0x3F})).give(kAck);
  wire->expect(read).give(data_frame({0, 0, 0xC0, 0x3F}));
  Command command = write("level", real(1.5));
  command.expect = number(0);
  EXPECT_EQ(run(std::move(command)).status, CommandStatus::succeeded);
}

TEST_F(CommandExecutionTest, ValueThatTheTagCannotShowIsNeverThere) {
  wire->expect(kReadBack).give(word_frame(45));
  const CommandResult result = run(write_50_expecting(real(45.4)));
  EXPECT_EQ(ending(result), "FAILED expect_mismatch");
  EXPECT_EQ(result.targets[0].verify->read, number(45));
}

// ---- strings of odd length ----------------------------------------------------------------------

TEST_F(CommandExecutionTest, OtherHalfOfTheLastWordStaysAsItIs) {
  const Bytes read = read_frame(kD250, 4);
  wire->expect(read).give(data_frame({'A', 'B', 'C', 'y'}));
  wire->expect(write_frame(kD250, Bytes{'D', 'E', 'F', 'y'})).give(kAck);
  wire->expect(read).give(data_frame({'D', 'E', 'F', 'z'}));  // changed since, by another writer
  const CommandResult result = run(write("name", text("DEF")));
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_TRUE(result.targets[0].verify->match);
  EXPECT_EQ(result.attempts, 1);
}

TEST_F(CommandExecutionTest, PartOfALongTextIsToldInWholeCharacters) {
  device.tags[3].point.length = 71;
  const auto read = [this] {
    wire->expect(read_frame(kD250, 8)).give(data_frame(Bytes(8, 'x')));
    wire->expect(read_frame(kD250 + 8, 64)).give(data_frame(Bytes(64, 'x')));
  };
  read();
  wire->expect(write_frame(kD250, Bytes(64, 'A'))).give(kAck);
  const Bytes rest = write_frame(kD250 + 64, joined(Bytes(7, 'A'), Bytes{'x'}));
  wire->expect(rest).give(kNak).expect(rest).give(kNak);
  read();
  const CommandResult result = run(write("name", text(std::string(71, 'A'))));
  EXPECT_EQ(result.status, CommandStatus::partial);
  EXPECT_EQ(result.progress, (Progress{64, 71}));
}

TEST_F(CommandExecutionTest, WhatCannotBeReadFirstIsNotWritten) {
  for (int i = 0; i <= device.retries; ++i) wire->expect(read_frame(kD250, 4)).give(kNak);
  EXPECT_EQ(ending(run(write("name", text("DEF")))), "FAILED nak");
}

TEST_F(CommandExecutionTest, UnexpectedValueWritesNothing) {
  wire->expect(kReadBack).give(word_frame(44));
  const CommandResult result = run(write_50_expecting(number(45)));
  EXPECT_EQ(ending(result), "FAILED expect_mismatch");
  EXPECT_EQ(result.plc, PlcAnswer::none);
  EXPECT_EQ(result.attempts, 0);
}

TEST_F(CommandExecutionTest, ExpectedPlaceWithoutAValueIsExplained) {
  device.tags[0].point.type = DataType::bcd16;
  wire->expect(kReadBack).give(word_frame(0xABCD));
  const CommandResult result = run(write_50_expecting(number(45)));
  EXPECT_EQ(ending(result), "FAILED expect_mismatch");
  EXPECT_EQ(result.detail, "nothing was written: ABCD is not BCD");
}

TEST_F(CommandExecutionTest, ExpectThatCannotBeReadFailsAndWritesNothing) {
  wire->expect(kReadBack).silence();
  const CommandResult result = run(write_50_expecting(number(45)));
  EXPECT_EQ(ending(result), "FAILED timeout") << "nothing was asked for: no unknown outcome";
  EXPECT_EQ(result.attempts, 0);
}

// ---- reads -------------------------------------------------------------------------------------

TEST_F(CommandExecutionTest, ReadHasItsValue) {
  wire->expect(read_frame(kD100, 2)).give(word_frame(0xFFFE));
  const CommandResult result = run(read("temp"));
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.targets[0].value, number(-2));
  EXPECT_EQ(result.targets[0].address, "D100");
}

TEST_F(CommandExecutionTest, ReadIsRepeatedAfterABadFrameAndAfterANak) {
  Bytes wrong = word_frame(7);
  wrong.back() = wrong.back() == '0' ? '1' : '0';
  wire->expect(read_frame(kD100, 2)).give(wrong);
  wire->expect(kEnq).give(kAck).expect(read_frame(kD100, 2)).give(kNak);
  wire->expect(read_frame(kD100, 2)).give(word_frame(7));
  EXPECT_EQ(run(read("temp")).targets[0].value, number(7));
}

TEST_F(CommandExecutionTest, ReadThatIsRefusedForGoodFailed) {
  for (int i = 0; i <= device.retries; ++i) wire->expect(read_frame(kD100, 2)).give(kNak);
  const CommandResult result = run(read("temp"));
  EXPECT_EQ(ending(result), "FAILED nak");
  EXPECT_EQ(result.plc, PlcAnswer::nak);
}

TEST_F(CommandExecutionTest, SilentReadFailedAndIsNeverUnknown) {
  wire->expect(read_frame(kD100, 2)).silence();
  EXPECT_EQ(ending(run(read("temp"))), "FAILED timeout");
}

TEST_F(CommandExecutionTest, LinkLostDuringAReadFailed) {
  wire->expect(read_frame(kD100, 2)).hang_up();
  EXPECT_EQ(ending(run(read("temp"))), "FAILED link_down");
}

TEST_F(CommandExecutionTest, ReadOfWhatIsNoNumberFailed) {
  wire->expect(read_frame(kD100, 4)).give(data_frame({0x00, 0x00, 0xC0, 0x7F}));  // NaN
  EXPECT_EQ(ending(run(read("flow"))), "FAILED bad_value");
}

// ---- run and stop ------------------------------------------------------------------------------

TEST_F(CommandExecutionTest, StopIsVerifiedByTheRunState) {
  wire->expect(kStop).give(kAck).expect(kProbe).give(kStopped);
  const CommandResult result = run(command(Op::stop));
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.plc, PlcAnswer::ack);
  ASSERT_TRUE(result.targets.at(0).verify);
  EXPECT_EQ(result.targets[0].verify->read, text("stop"));
  EXPECT_TRUE(result.targets[0].verify->match);
}

TEST_F(CommandExecutionTest, RunStateMayTakeAMomentToFollow) {
  wire->expect(kRun).give(kAck).expect(kProbe).give(kStopped).expect(kProbe).give(kRunning);
  const CommandResult result = run(command(Op::run));
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.targets[0].verify.value_or(Verification{}).read, text("run"));
}

TEST_F(CommandExecutionTest, StopThatIsRefusedByAStoppedPlcSucceeded) {
  wire->expect(kStop).give(kNak).expect(kProbe).give(kStopped);
  const CommandResult result = run(command(Op::stop));
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.plc, PlcAnswer::nak);
  EXPECT_EQ(result.attempts, 1) << "run and stop are never repeated";
}

TEST_F(CommandExecutionTest, StopIsNotRepeatedAfterSilence) {
  wire->expect(kStop).silence();
  wire->expect(kEnq).give(kAck).expect(kProbe).give(kStopped);  // the read that acts as barrier
  wire->expect(kProbe).give(kStopped);
  const CommandResult result = run(command(Op::stop));
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.plc, PlcAnswer::none);
  EXPECT_EQ(result.attempts, 1);
}

TEST_F(CommandExecutionTest, StopOverALinkThatBreaksIsSettledByTheNextConnection) {
  wire->expect(kStop).hang_up();
  wire->expect(kEnq).give(kAck).expect(kProbe).give(kStopped).expect(kProbe).give(kStopped);
  const CommandResult result = run(command(Op::stop));
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.plc, PlcAnswer::none);
}

TEST_F(CommandExecutionTest, PlcThatKeepsRunningIsAMismatchThatNamesTheSwitch) {
  wire->expect(kStop).give(kAck);
  wire->then([](ByteView) { return kRunning; });
  const CommandResult result = run(command(Op::stop));
  EXPECT_EQ(ending(result), "FAILED verify_mismatch");
  EXPECT_EQ(result.targets[0].verify.value_or(Verification{}).read, text("run"));
  EXPECT_NE(result.detail.find("switch"), std::string::npos) << result.detail;
}

// The ACK was a late one; the NAK after it is the PLC's real answer to this STOP.
TEST_F(CommandExecutionTest, StopWithAnotherAnswerBehindItsAckAndARunningPlcIsNoVerifyMismatch) {
  wire->expect(kStop).give(kAck).expect(kProbe).give(joined(kNak, kRunning));
  FakePort plc;
  plc.set(kM8000, {0x01});
  wire->then([&plc](ByteView request) { return plc.answer(request); });
  const CommandResult result = run(command(Op::stop));
  EXPECT_EQ(ending(result), "UNKNOWN_OUTCOME bad_frame");
  EXPECT_EQ(result.plc, PlcAnswer::none);
  EXPECT_EQ(result.targets.at(0).verify.value_or(Verification{}).read, text("run"));
}

TEST_F(CommandExecutionTest, RunStateIsAskedForTwoSecondsAndNoLonger) {
  wire->expect(kStop).give(kAck);
  wire->then([](ByteView) { return kRunning; });
  const auto began = Clock::now();
  run(command(Op::stop));
  // Polls every 100 ms, unless the poll would end after the 2 s; a slow machine polls less often.
  EXPECT_GE(Clock::now() - began, milliseconds(1900));
  EXPECT_LE(wire->written().size(), 2U + 20U) << "the enquiry, the command, and the questions";
}

// ---- line time ---------------------------------------------------------------------------------

TEST_F(CommandExecutionTest, LineTimeCountsEachReadingOfACommand) {
  const milliseconds character{1};
  const auto planned = [&](std::string id, bool verify, std::optional<Value> expect) {
    Command command = write_50();
    command.id = std::move(id);
    command.verify = verify;
    command.expect = std::move(expect);
    AdmittedCommand each = admitted(admission, std::move(command), device.codec);
    return set_line_times(*device.codec, device, limits, character, each);
  };
  const nanoseconds write_alone = planned("1", false, std::nullopt);
  EXPECT_EQ(write_alone, (kWrite50.size() + kAck.size()) * character + milliseconds(30));
  const nanoseconds reading =
      (kReadBack.size() + word_frame(50).size()) * character + milliseconds(30);
  EXPECT_EQ(planned("2", true, std::nullopt) - write_alone, reading) << "the read-back";
  EXPECT_EQ(planned("3", false, number(45)) - write_alone, reading) << "what is expected";
  EXPECT_EQ(planned("4", true, number(45)) - write_alone, 2 * reading);
  // The number of exchanges matches.
  wire->expect(kReadBack).give(word_frame(45)).expect(kWrite50).give(kAck);
  wire->expect(kReadBack).give(word_frame(50));
  Command command = write_50();
  command.expect = number(45);
  EXPECT_EQ(run(command).status, CommandStatus::succeeded);
}

// ---- lists -------------------------------------------------------------------------------------

struct CommandExecutionOfAList : CommandExecutionTest {
  Command list() {
    Command out = write_50();
    out.is_list = true;
    out.verify = false;
    out.targets.push_back(target_of("start", flag(true)));
    out.targets.push_back(target_of("setpoint", number(51)));
    return out;
  }
  const Bytes write_51 = write_frame(kD200, word(51));
};

TEST_F(CommandExecutionOfAList, TargetsAreSentInTheirOrder) {
  wire->expect(kWrite50).give(kAck).expect(kForceOn).give(kAck).expect(write_51).give(kAck);
  const CommandResult result = run(list());
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.attempts, 3);
  ASSERT_EQ(result.targets.size(), 3U);
  for (const TargetResult& target : result.targets)
    EXPECT_EQ(target.status, CommandStatus::succeeded);
  EXPECT_FALSE(result.one_frame) << "the programming port has no frame for several places";
}

TEST_F(CommandExecutionOfAList, StopsAtTheFirstThatDoesNotSucceed) {
  wire->expect(kWrite50).give(kAck).expect(kForceOn).give(kNak).expect(kForceOn).give(kNak);
  const CommandResult result = run(list());
  EXPECT_EQ(result.status, CommandStatus::partial);
  EXPECT_EQ(result.progress, (Progress{1, 3}));
  EXPECT_EQ(result.reason, Reason::nak);
  EXPECT_EQ(result.plc, PlcAnswer::nak);
  ASSERT_EQ(result.targets.size(), 3U);
  EXPECT_EQ(result.targets[0].status, CommandStatus::succeeded);
  EXPECT_EQ(ending(result.targets[1]), "FAILED nak");
  EXPECT_EQ(result.targets[2].status, CommandStatus::failed);
  EXPECT_NE(result.targets[2].detail.find("not sent"), std::string::npos);
}

TEST_F(CommandExecutionOfAList, UnknownOutcomeStopsItToo) {
  wire->expect(kWrite50).silence().expect(kEnq).silence();
  const CommandResult result = run(list());
  EXPECT_EQ(result.status, CommandStatus::unknown_outcome);
  EXPECT_EQ(result.targets[1].status, CommandStatus::failed);
  EXPECT_EQ(result.targets[2].status, CommandStatus::failed);
}

}  // namespace
}  // namespace fxagent::test
