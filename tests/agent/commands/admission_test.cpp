#include "agent/commands/admission.h"

#include <gtest/gtest.h>

#include "agent/commands/parse/parse.h"
#include "agent/commands/result.h"
#include "agent/commands/shared_admission.h"
#include "protocol/catalog.h"
#include "tests/agent/field/field_plant.h"
#include "tests/agent/field/port_frames.h"
#include "tests/support/says.h"

namespace fxagent::test {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using std::chrono::seconds;

const SteadyTime kStart{hours(1000)};
constexpr std::int64_t kStartMs = 1790000000000;

/// Raw writes to D100 and M100-M107 are allowed; RUN and STOP are not.
DeviceConfig press() {
  DeviceConfig device = port_device();
  const Codec& codec = *device.codec;
  device.tags.push_back(tag(codec, "temp", "D120"));
  device.tags.push_back(writable(scaled(tag(codec, "setpoint", "D200"), 0.1)));
  device.tags.back().units =
      std::make_shared<const TagUnits>(TagUnits{.limits = {.min = 0.0, .max = 100.0}});
  device.tags.push_back(writable(tag(codec, "start", "M50")));
  device.tags.push_back(writable(tag(codec, "name", "D250", DataType::string)));
  device.tags.back().point.length = 4;
  device.tags.push_back(writable(array_of(tag(codec, "recipe", "D210"), 3)));
  for (const char* range : {"D100", "M100-M107", "D500-D501", "TN5", "TS5"})
    device.commands.allow.push_back(*codec.addresses().parse_range(range));
  return device;
}

/// Admission, its device, and a manually advanced clock.
struct CommandAdmissionTest : ::testing::Test {
  /// A valid command.
  Command write(std::string id, double value = 50) {
    return stamped(
        command_of(std::move(id), Op::write, {{"setpoint", "", std::nullopt, real(value)}}));
  }
  /// The same to another tag.
  Command write_to(const std::string& tag, std::string id, double value) {
    Command command = write(std::move(id), value);
    command.targets[0].tag = tag;
    return command;
  }
  Command stamped(Command command) const {
    command.received = now;
    command.received_ms = kStartMs + (now - kStart) / milliseconds(1);
    return command;
  }
  Command raw(std::string id, std::string address, Value value,
              std::optional<DataType> type = std::nullopt) {
    Command command = write(std::move(id));
    command.targets[0] = {"", std::move(address), type, std::move(value)};
    return command;
  }
  Command read(std::string id, std::string tag, std::string address = "") {
    return stamped(command_of(std::move(id), Op::read,
                              {{std::move(tag), std::move(address), std::nullopt, std::nullopt}}));
  }
  Command force(std::string id, std::string address) {
    return stamped(command_of(std::move(id), Op::force_on,
                              {{"", std::move(address), std::nullopt, std::nullopt}}));
  }
  Command command(std::string id, Op op) { return stamped(command_of(std::move(id), op)); }

  CommandAdmission::Decision decide(Command command, std::size_t waiting = 0) {
    return admission.admit(std::move(command), device.codec, waiting, now);
  }
  /// Returns the result of a command that is answered at once. Otherwise returns an empty result
  /// and reports a failure.
  CommandResult answered(Command command, std::size_t waiting = 0) {
    auto decision = decide(std::move(command), waiting);
    if (auto* result = std::get_if<CommandResult>(&decision)) return *result;
    ADD_FAILURE() << "admitted";
    return {};
  }
  AdmittedCommand admit(Command command) {
    auto decision = decide(std::move(command));
    if (auto* admitted = std::get_if<AdmittedCommand>(&decision)) return std::move(*admitted);
    const auto& result = std::get<CommandResult>(decision);
    ADD_FAILURE() << to_string(result.reason) << ": " << result.detail;
    return {};
  }
  void finish(const std::string& id, CommandStatus status = CommandStatus::succeeded) {
    CommandResult result;
    result.id = id;
    result.status = status;
    result.plc = PlcAnswer::ack;
    admission.finished(result);
  }

  DeviceConfig device = press();
  CommandAdmission admission{device};
  SteadyTime now = kStart;
};

// ---- the table of checks -----------------------------------------------------------------------

/// Each check of the contract, in its order, with a change that fails this check and no other.
struct CommandAdmissionFaults : CommandAdmissionTest {
  using Spoil = std::function<void(Command&)>;
  struct Case {
    Reason reason;
    CommandStatus status;
    Spoil spoil;
  };
  /// Checks that can fail together in one command: each change affects a different part.
  const std::vector<Case> cases{
      {Reason::retained, CommandStatus::rejected, [](Command& c) { c.retained = true; }},
      {Reason::bad_op, CommandStatus::rejected,
       [](Command& c) {
         c.op.reset();
         c.op_text = "explode";
       }},
      {Reason::unknown_tag, CommandStatus::rejected,
       [](Command& c) { c.targets[0].tag = "presure"; }},
      {Reason::not_writable, CommandStatus::rejected,
       [](Command& c) { c.targets[0].tag = "temp"; }},
      {Reason::bad_value, CommandStatus::rejected,
       [](Command& c) { c.expires_ms = c.received_ms + 3600 * 1000 + 1; }},
      {Reason::out_of_range, CommandStatus::rejected,
       [](Command& c) { c.targets[0].value = real(100.5); }},
      {Reason::expired, CommandStatus::expired, [](Command& c) { c.message_expiry = seconds(-1); }},
  };
};

TEST_F(CommandAdmissionFaults, EachFaultHasItsStatusAndItsReason) {
  for (const Case& one : cases) {
    Command command = write(std::string(to_string(one.reason)));
    one.spoil(command);
    const CommandResult result = answered(command);
    EXPECT_EQ(result.status, one.status) << to_string(one.reason);
    EXPECT_EQ(to_string(result.reason), to_string(one.reason));
    EXPECT_FALSE(result.detail.empty()) << to_string(one.reason);
    EXPECT_EQ(result.plc, PlcAnswer::none);
    EXPECT_EQ(result.attempts, 0);
  }
}

TEST_F(CommandAdmissionFaults, OfTwoFaultsTheFirstInTheOrderOfTheContractWins) {
  for (std::size_t i = 0; i < cases.size(); ++i) {
    for (std::size_t j = i + 1; j < cases.size(); ++j) {
      const bool same_part = cases[i].reason == Reason::unknown_tag &&
                             cases[j].reason == Reason::not_writable;  // one tag cannot be both
      if (same_part) continue;
      const std::string names =
          std::string(to_string(cases[i].reason)) + " " + std::string(to_string(cases[j].reason));
      Command command = write(names);
      cases[j].spoil(command);
      cases[i].spoil(command);
      EXPECT_EQ(to_string(answered(command).reason), to_string(cases[i].reason)) << names;
    }
  }
}

TEST_F(CommandAdmissionFaults, EveryFaultComesBeforeAFullQueue) {
  for (const Case& one : cases) {
    Command command = write(std::string(to_string(one.reason)));
    one.spoil(command);
    EXPECT_EQ(to_string(answered(command, device.commands.queue).reason), to_string(one.reason));
  }
}

TEST_F(CommandAdmissionFaults, KnownIdComesBeforeEveryOtherFault) {
  admit(write("b7e1"));
  for (const Case& one : cases) {
    Command command = write("b7e1");
    one.spoil(command);
    EXPECT_EQ(answered(command).status, CommandStatus::duplicate) << to_string(one.reason);
  }
}

TEST_F(CommandAdmissionFaults, WhatTheParserFoundIsToldInItsPlace) {
  for (const Reason found : {Reason::too_large, Reason::bad_json, Reason::missing_id}) {
    for (const Case& one : cases) {
      Command command = write("");
      one.spoil(command);
      command.refusal = Refusal{found, "as the parser says"};
      const CommandResult result = answered(command);
      EXPECT_EQ(result.status, CommandStatus::rejected);
      EXPECT_EQ(to_string(result.reason), to_string(found));
      EXPECT_EQ(result.detail, "as the parser says");
      EXPECT_TRUE(result.id.empty());
    }
  }
  EXPECT_EQ(admission.remembered(), 0U) << "no id, nothing to remember";
}

TEST_F(CommandAdmissionFaults, BadValueOfTheParserWaitsForItsTurn) {
  for (const Case& one : cases) {
    Command command = write(std::string("parsed ") + std::string(to_string(one.reason)));
    one.spoil(command);
    command.refusal = Refusal{Reason::bad_value, "verify must be true or false"};
    const bool first = one.reason < Reason::bad_value;
    EXPECT_EQ(to_string(answered(command).reason),
              to_string(first ? one.reason : Reason::bad_value));
  }
}

TEST_F(CommandAdmissionTest, RightCommandIsAdmittedWithItsImageAndItsRequests) {
  const AdmittedCommand admitted = admit(write("b7e1", 12.34));
  ASSERT_EQ(admitted.targets.size(), 1U);
  EXPECT_EQ(admitted.targets[0].image, word(123)) << "the nearest integer of 12.34 / 0.1";
  EXPECT_EQ(admitted.targets[0].written, real(12.3)) << "what is really written";
  EXPECT_EQ(admitted.targets[0].point.address.text, "D200");
  ASSERT_EQ(admitted.targets[0].requests.size(), 1U);
  const auto frame = device.codec->encode(admitted.targets[0].requests[0], 0);
  EXPECT_EQ(to_hex(*frame), to_hex(write_frame(kD200, word(123))));
  EXPECT_EQ(admitted.deadline, kStart + seconds(10));
}

TEST_F(CommandAdmissionTest, FullQueueRefuses) {
  const CommandResult result = answered(write("b7e1"), device.commands.queue);
  EXPECT_EQ(result.status, CommandStatus::rejected);
  EXPECT_EQ(result.reason, Reason::queue_full);
  EXPECT_TRUE(
      std::holds_alternative<AdmittedCommand>(decide(write("b7e2"), device.commands.queue - 1)));
}

TEST_F(CommandAdmissionTest, ResultEchoesWhatTheSenderNeeds) {
  Command command = write("b7e1");
  command.targets[0].tag = "presure";
  command.response_topic = "flows/7";
  command.correlation = {1, 2, 3};
  const CommandResult result = answered(command);
  EXPECT_EQ(result.id, "b7e1");
  EXPECT_EQ(result.op, "write");
  EXPECT_EQ(result.response_topic, "flows/7");
  EXPECT_EQ(result.correlation, (Bytes{1, 2, 3}));
  EXPECT_EQ(result.received_ms, kStartMs);
  ASSERT_EQ(result.targets.size(), 1U);
  EXPECT_EQ(result.targets[0].tag, "presure");
}

// ---- ids ---------------------------------------------------------------------------------------

TEST_F(CommandAdmissionTest, DuplicateOfARunningCommandHasNoFirstResultYet) {
  admit(write("b7e1"));
  const CommandResult result = answered(write("b7e1", 60));
  EXPECT_EQ(result.status, CommandStatus::duplicate);
  EXPECT_EQ(result.reason, Reason::duplicate_id);
  EXPECT_EQ(result.first, nullptr);
  EXPECT_EQ(result.plc, PlcAnswer::none);
}

TEST_F(CommandAdmissionTest, DuplicateOfAFinishedCommandCarriesItsResult) {
  admit(write("b7e1"));
  finish("b7e1");
  for (int i = 0; i < 3; ++i) {
    const CommandResult result = answered(write("b7e1", 60));
    EXPECT_EQ(result.status, CommandStatus::duplicate);
    ASSERT_NE(result.first, nullptr);
    EXPECT_EQ(result.first->status, CommandStatus::succeeded);
    EXPECT_EQ(result.plc, PlcAnswer::ack) << "as first";
  }
}

TEST_F(CommandAdmissionTest, ResponseTopicOfAResultIsNotRemembered) {
  Command command = write("b7e1");
  command.response_topic = "flows/7";
  command.correlation = Bytes(60000, 1);
  CommandResult result;
  result.id = "b7e1";
  result.response_topic = command.response_topic;
  result.correlation = command.correlation;
  admit(std::move(command));
  admission.finished(result);
  const CommandResult again = answered(write("b7e1"));
  ASSERT_NE(again.first, nullptr);
  EXPECT_TRUE(again.first->response_topic.empty());
  EXPECT_TRUE(again.first->correlation.empty());
}

TEST_F(CommandAdmissionTest, WithAJournalOnlyTheIdsAreKeptHere) {
  const auto room = std::make_shared<SharedAdmission>();
  room->is_journaled = true;
  CommandAdmission beside_journal(device, room);
  const auto judge = [&](const char* id) {
    return std::get<CommandResult>(beside_journal.admit(write(id), device.codec, 0, now));
  };
  beside_journal.restore({"press1", "earlier", 7, kStartMs - 1000, kStartMs + 60000}, now,
                         kStartMs);
  Command own = write("own");
  own.number = 8;
  beside_journal.admit(own, device.codec, 0, now);
  EXPECT_FALSE(judge("own").first_number);
  CommandResult done;
  done.id = "own";
  beside_journal.finished(done);
  for (const char* id : {"earlier", "own"}) {
    const CommandResult again = judge(id);
    EXPECT_EQ(again.status, CommandStatus::duplicate) << id;
    EXPECT_EQ(again.first_number, id == std::string("own") ? 8U : 7U) << id;
    EXPECT_EQ(again.first, nullptr) << id;
  }
}

TEST_F(CommandAdmissionTest, RestoredIdLivesOutItsDayAndItsDeadline) {
  const std::int64_t utc = kStartMs;
  const auto restore = [&](std::string id, std::chrono::hours age, std::chrono::hours deadline_in) {
    admission.restore({"press1", std::move(id), 0, utc - milliseconds(age).count(),
                       utc + milliseconds(deadline_in).count()},
                      now, utc);
  };
  restore("old", std::chrono::hours(23), std::chrono::hours(-22));
  restore("late", std::chrono::hours(23), std::chrono::hours(3));
  restore("old", std::chrono::hours(1), std::chrono::hours(1));  // one id is enough
  EXPECT_EQ(admission.remembered(), 2U);
  now += std::chrono::hours(2);
  admit(write("another"));
  admit(write("old"));
  EXPECT_EQ(answered(write("late")).status, CommandStatus::duplicate);
}

// Results dated an hour in the future do not occupy the memory until then.
TEST_F(CommandAdmissionTest, RestoredIdHasNoMoreTimeThanItWasGiven) {
  for (std::size_t i = 0; i < kRememberedIds + kFingerprints; ++i) {
    const std::int64_t received_ms = kStartMs + 3600000;
    admission.restore({"press1", std::to_string(i), 0, received_ms, received_ms + 10000}, now,
                      kStartMs);
  }
  EXPECT_EQ(answered(write("one more")).reason, Reason::queue_full);
  now += std::chrono::seconds(11);
  admit(write("another"));
}

// The clock was set back by ten days while the agent was stopped: the id expires one day from now,
// not in eleven days.
TEST_F(CommandAdmissionTest, RestoredIdOfATimeToComeIsForgottenAfterItsDay) {
  const std::int64_t received_ms = kStartMs + milliseconds(std::chrono::hours(240)).count();
  admission.restore({"press1", "ahead", 0, received_ms, received_ms + 10000}, now, kStartMs);
  now += std::chrono::hours(24) - std::chrono::seconds(1);
  EXPECT_EQ(answered(write("ahead")).status, CommandStatus::duplicate);
  now += std::chrono::seconds(2);
  admit(write("ahead"));
}

TEST_F(CommandAdmissionTest, InterruptedBroadcastIsNotReadBack) {
  DeviceConfig all = device_on("modbus-rtu", codec_of("modbus-rtu", {{"unit", std::int64_t{0}}}));
  all.commands.allow.push_back(*all.codec->addresses().parse_range("hr:1"));
  CommandAdmission of_all{all};
  EXPECT_FALSE(of_all.interrupted(raw("a", "hr:1", number(5)), all.codec, now));
  DeviceConfig one = device_on("modbus-rtu", codec_of("modbus-rtu", {}));
  one.commands.allow = all.commands.allow;
  CommandAdmission of_one{one};
  EXPECT_TRUE(of_one.interrupted(raw("a", "hr:1", number(5)), one.codec, now))
      << "a unit of its own";
}

TEST_F(CommandAdmissionTest, PlaceThatHasAnotherNameOnThePlcIsRefused) {
  const auto model = [](const char* name) {
    return codec_of("mc-3e", {{"model", std::string(name)}});
  };
  DeviceConfig q = device_on("mc-3e", model("Q"));
  for (const char* range : {"Y0-YFF", "D0-D10"})
    q.commands.allow.push_back(*q.codec->addresses().parse_range(range));
  CommandAdmission of_q{q};
  int id = 0;
  const auto refusal = [&](std::string address) {
    auto decision =
        of_q.admit(raw(std::to_string(++id), std::move(address), number(1)), q.codec, 0, now);
    const auto* result = std::get_if<CommandResult>(&decision);
    return result == nullptr ? "" : std::string(to_string(result->reason)) + " " + result->detail;
  };
  EXPECT_EQ(refusal("Y10"), "");
  of_q.plc_has(model("FX5U"));
  expect_says(refusal("Y10"),
              "bad_address Y10 is Y20 on this PLC: it is an FX5U, but the config says Q");
  EXPECT_EQ(refusal("Y7"), "") << "the same output on both";
  expect_says(refusal("K4Y0"), "bad_address Y0 to YF is Y0 to Y17 on this PLC");
  of_q.use(q);
  EXPECT_NE(refusal("Y10"), "") << "a reload of the config is no other PLC";
  EXPECT_EQ(refusal("D10"), "");
  of_q.plc_has(nullptr);
  EXPECT_EQ(refusal("Y10"), "");
}

TEST_F(CommandAdmissionTest, IdOfAnInterruptedCommandIsKnownWithoutAResult) {
  const auto admitted = admission.interrupted(write("left"), device.codec, now);
  ASSERT_TRUE(admitted);
  EXPECT_TRUE(admitted->interrupted);
  const CommandResult again = answered(write("left"));
  EXPECT_EQ(again.status, CommandStatus::duplicate);
  EXPECT_EQ(again.first, nullptr);
  CommandResult result = result_of(admitted->command);
  result.status = CommandStatus::unknown_outcome;
  admission.finished(result);
  ASSERT_NE(answered(write("left")).first, nullptr);
}

TEST_F(CommandAdmissionTest, InterruptedCommandThatReadingDoesNotTellOfIsKnownAllTheSame) {
  Command gone = write("gone");
  gone.targets[0].tag = "no_such_tag";
  EXPECT_FALSE(admission.interrupted(gone, device.codec, now));
  EXPECT_EQ(answered(write("gone")).status, CommandStatus::duplicate);
}

TEST_F(CommandAdmissionTest, RejectedAndExpiredIdsAreRememberedToo) {
  Command late = write("late");
  late.expires_ms = kStartMs - 1;
  EXPECT_EQ(answered(late).status, CommandStatus::expired);
  EXPECT_EQ(answered(write("range", 500)).reason, Reason::out_of_range);
  for (const char* id : {"late", "range"}) {
    const CommandResult again = answered(write(id));
    EXPECT_EQ(again.status, CommandStatus::duplicate) << id;
    ASSERT_NE(again.first, nullptr) << id;
    EXPECT_NE(again.first->recorded.find(R"("reason":")"), std::string::npos) << id;
  }
}

TEST_F(CommandAdmissionTest, BadJsonWithAReadableIdIsRemembered) {
  Command broken = write("b7e1");
  broken.refusal = Refusal{Reason::bad_json, "unknown key \"valeu\""};
  const CommandResult result = answered(broken);
  EXPECT_EQ(result.status, CommandStatus::rejected);
  EXPECT_EQ(result.reason, Reason::bad_json);
  EXPECT_EQ(result.id, "b7e1");
  const CommandResult again = answered(write("b7e1"));
  EXPECT_EQ(again.status, CommandStatus::duplicate);
  ASSERT_NE(again.first, nullptr);
  EXPECT_NE(again.first->recorded.find(R"("reason":"bad_json")"), std::string::npos);
}

TEST_F(CommandAdmissionTest, DryRunChecksEverythingAndIsNotRemembered) {
  Command dry = write("b7e1");
  dry.dry_run = true;
  const CommandResult result = answered(dry);
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_TRUE(result.dry_run);
  EXPECT_EQ(result.plc, PlcAnswer::none);
  EXPECT_EQ(result.targets.at(0).address, "D200");
  Command wrong = write("b7e1", 500);
  wrong.dry_run = true;
  EXPECT_EQ(answered(wrong).reason, Reason::out_of_range);
  EXPECT_EQ(admission.remembered(), 0U);
  admit(write("b7e1"));
  EXPECT_EQ(answered(dry).status, CommandStatus::duplicate);
}

TEST_F(CommandAdmissionTest, DryRunOfAForceOrAReadChangesNothingEither) {
  for (const Op op : {Op::force_on, Op::force_off, Op::read}) {
    Command dry = command("b7e1", op);
    dry.targets.push_back({"start", "", std::nullopt, std::nullopt});
    dry.dry_run = true;
    EXPECT_EQ(answered(dry).status, CommandStatus::succeeded) << to_string(op);
    EXPECT_EQ(admission.remembered(), 0U);
  }
}

TEST_F(CommandAdmissionTest, DryRunThatIsBadJsonIsNotRemembered) {
  Command dry = write("b7e1");
  dry.dry_run = true;
  dry.refusal = Refusal{Reason::bad_json, "unknown key \"valeu\""};
  EXPECT_EQ(answered(dry).reason, Reason::bad_json);
  EXPECT_EQ(admission.remembered(), 0U);
}

TEST_F(CommandAdmissionTest, IdIsForgottenAfterADay) {
  admit(write("b7e1"));
  finish("b7e1");
  now += hours(24) - milliseconds(1);
  EXPECT_EQ(answered(write("b7e1")).status, CommandStatus::duplicate);
  now += milliseconds(1);
  admit(write("b7e1"));  // even if no other command came in between
  EXPECT_EQ(admission.remembered(), 1U);
}

TEST_F(CommandAdmissionTest, IdIsKeptUntilItsDeadlineEvenAfterADay) {
  device.commands.max_expiry = hours(48);
  Command lasting = write("b7e1");
  lasting.expires_ms = kStartMs + milliseconds(hours(30)).count();
  admit(lasting);
  finish("b7e1");
  now += hours(29);
  admit(write("other"));
  EXPECT_EQ(answered(write("b7e1")).status, CommandStatus::duplicate);
}

TEST_F(CommandAdmissionTest, IdOfARunningCommandIsNeverForgotten) {
  admit(write("b7e1"));
  now += hours(25);
  admit(write("other"));
  EXPECT_EQ(answered(write("b7e1")).status, CommandStatus::duplicate);
}

// 10,500 reads with deadlines an hour away; half of them are refused.
TEST_F(CommandAdmissionTest, ManyReadsThatLastAnHourLockNobodyOut) {
  for (std::size_t i = 0; i < 10500; ++i) {
    const std::string id = "id" + std::to_string(i);
    Command command = read(id, i % 2 == 0 ? "temp" : "nothing");
    command.expires_ms = kStartMs + 3600 * 1000;
    decide(command);
    finish(id);
  }
  admit(write("another's"));
  EXPECT_EQ(answered(read("id0", "temp")).status, CommandStatus::duplicate);
}

// Otherwise a repeat could carry out a command that was refused while the queue was full.
TEST_F(CommandAdmissionTest, RefusedCommandStaysRefusedWhereTheMemoryIsFull) {
  for (std::size_t i = 0; i < kRememberedIds; ++i) {
    decide(write("id" + std::to_string(i)));
    finish("id" + std::to_string(i));
  }
  EXPECT_EQ(answered(write("late", 500)).status, CommandStatus::rejected);
  const CommandResult repeat = answered(write("late"));
  EXPECT_EQ(repeat.status, CommandStatus::duplicate);
  ASSERT_TRUE(repeat.first);
  EXPECT_NE(repeat.first->recorded.find(R"("reason":"out_of_range")"), std::string::npos);
}

TEST_F(CommandAdmissionTest, OfTenThousandIdsTheOldestIsKnownWithoutItsResult) {
  for (std::size_t i = 0; i < kRememberedIds + 1; ++i) {
    Command command = write("id" + std::to_string(i));
    command.expires_ms = kStartMs + 60000;
    ASSERT_TRUE(std::holds_alternative<AdmittedCommand>(decide(command)));
    finish("id" + std::to_string(i));
  }
  EXPECT_EQ(admission.remembered(), kRememberedIds);
  const CommandResult oldest = answered(write("id0"));
  EXPECT_EQ(oldest.status, CommandStatus::duplicate);
  EXPECT_FALSE(oldest.first);
  EXPECT_FALSE(oldest.first_number);
  EXPECT_NE(oldest.detail.find("no longer kept"), std::string::npos);
  EXPECT_TRUE(answered(write("id1")).first);
}

TEST_F(CommandAdmissionTest, CheckOfAFullMemoryComesAfterTheOthers) {
  for (std::size_t i = 0; i < kRememberedIds; ++i)
    ASSERT_TRUE(std::holds_alternative<AdmittedCommand>(decide(write("id" + std::to_string(i)))));
  EXPECT_EQ(answered(write("one more", 500)).reason, Reason::out_of_range);
  EXPECT_EQ(answered(write("one more still")).reason, Reason::queue_full)
      << "all of them are running";
}

TEST_F(CommandAdmissionTest, WaitingCommandsAreBoundedInBytesToo) {
  std::vector<AdmittedCommand> waiting;
  Command large = raw("", "D500", numbers({1, 2}));
  large.by = std::string(200000, 'x');
  int taken = 0;
  for (int i = 0; i < 60; ++i) {
    large.id = "large" + std::to_string(i);
    auto decision = decide(large);
    if (auto* admitted = std::get_if<AdmittedCommand>(&decision)) {
      ++taken;
      waiting.push_back(std::move(*admitted));
    } else {
      EXPECT_EQ(std::get<CommandResult>(decision).reason, Reason::queue_full);
    }
  }
  EXPECT_GT(taken, 10);
  EXPECT_LT(taken, 30);
  Command elsewhere = write("small one of another device");
  elsewhere.device = 1;
  admit(elsewhere);
  waiting.clear();
  large.id = "again";
  admit(large);
}

TEST(SharedAdmission, EachDeviceHasAShareWhateverTheOthersHold) {
  const auto room = std::make_shared<SharedAdmission>();
  constexpr std::size_t kShare = SharedAdmission::kBytesOfADevice;
  const auto all = room->take(0, SharedAdmission::kMostBytes);
  ASSERT_TRUE(all);
  EXPECT_FALSE(room->take(0, 1));
  const auto share = room->take(1, kShare);
  EXPECT_TRUE(share);
  EXPECT_FALSE(room->take(1, 1));
  EXPECT_TRUE(room->take(2, kShare));
}

// ---- expiry ------------------------------------------------------------------------------------

TEST_F(CommandAdmissionTest, ExpiryBecomesTimeFromReceipt) {
  Command command = write("b7e1");
  command.expires_ms = kStartMs + 2500;
  EXPECT_EQ(admit(command).deadline, kStart + milliseconds(2500));
}

TEST_F(CommandAdmissionTest, SoonerOfBothExpiriesWins) {
  Command by_message = write("a");
  by_message.expires_ms = kStartMs + 9000;
  by_message.message_expiry = seconds(5);
  EXPECT_EQ(admit(by_message).deadline, kStart + seconds(5));
  Command by_key = write("b");
  by_key.expires_ms = kStartMs + 3000;
  by_key.message_expiry = seconds(5);
  EXPECT_EQ(admit(by_key).deadline, kStart + seconds(3));
  Command by_default = write("c");
  by_default.message_expiry = seconds(500);
  EXPECT_EQ(admit(by_default).deadline, kStart + seconds(10));
}

TEST_F(CommandAdmissionTest, CommandThatWaitedTooLongBeforeTheDeskIsExpired) {
  Command command = write("b7e1");
  command.expires_ms = kStartMs + 1000;
  now += milliseconds(1001);
  EXPECT_EQ(answered(command).status, CommandStatus::expired);
}

TEST_F(CommandAdmissionTest, ExpiryBeyondTheLongestAllowedTellsOfAWrongClock) {
  Command command = write("b7e1");
  command.expires_ms = kStartMs + 3600 * 1000 + 1;
  const CommandResult result = answered(command);
  EXPECT_EQ(result.reason, Reason::bad_value);
  EXPECT_NE(result.detail.find("clock"), std::string::npos);
  Command longest = write("b7e2");
  longest.expires_ms = kStartMs + 3600 * 1000;
  admit(longest);
}

TEST_F(CommandAdmissionTest, AbsurdExpiriesAreNeitherFreshNorACrash) {
  constexpr auto kMin = std::numeric_limits<std::int64_t>::min();
  constexpr auto kMax = std::numeric_limits<std::int64_t>::max();
  // -1e13 ms from now does not fit into 64-bit nanoseconds.
  for (const std::int64_t long_past : {kMin, kMin + 1, std::int64_t{-10000000000000},
                                       std::int64_t{-1}, std::int64_t{0}, std::int64_t{1}}) {
    Command command = write("past " + std::to_string(long_past));
    command.expires_ms = long_past;
    EXPECT_EQ(answered(command).status, CommandStatus::expired) << long_past;
  }
  Command in_seconds = write("in seconds");
  in_seconds.expires_ms = in_seconds.received_ms / 1000 + 5;
  EXPECT_EQ(answered(in_seconds).detail,
            "the command had expired when it arrived; expires is in milliseconds since 1970");
  Command late = write("late");
  late.expires_ms = late.received_ms - 40;
  EXPECT_EQ(answered(late).detail,
            "the command had expired when it arrived, 40 ms ago by this agent's clock");
  Command never = write("never");
  never.expires_ms = kMax;
  EXPECT_EQ(answered(never).reason, Reason::bad_value);
}

// ---- places -------------------------------------------------------------------------------------

TEST_F(CommandAdmissionTest, RawWriteMustBeCoveredWhole) {
  admit(raw("one word", "D100", number(5)));
  const CommandResult half = answered(raw("half", "D100", number(5), DataType::int32));
  EXPECT_EQ(half.reason, Reason::not_allowed) << "int32 at D100 also touches D101";
  device.commands.allow.push_back(*device.codec->addresses().parse_range("D102"));
  EXPECT_EQ(answered(raw("hole", "D100", numbers({1, 2, 3}))).reason, Reason::not_allowed);
  device.commands.allow.push_back(*device.codec->addresses().parse_range("D101"));
  admit(raw("ranges that meet", "D100", numbers({1, 2, 3})));
  device.commands.allow.pop_back();
  admit(raw("both", "D500", number(5), DataType::int32));
  EXPECT_EQ(answered(raw("array", "D500", numbers({1, 2, 3}))).reason, Reason::not_allowed);
  EXPECT_EQ(answered(raw("none", "D101", number(5))).reason, Reason::not_allowed);
  admit(raw("last bit", "M107", flag(true)));
  EXPECT_EQ(answered(raw("next bit", "M108", flag(true))).reason, Reason::not_allowed);
}

TEST_F(CommandAdmissionTest, AddressThatIsNotAllowedIsNamedWholeAndWithItsTag) {
  EXPECT_EQ(answered(raw("one", "D101", number(5))).detail, "commands.allow does not cover D101");
  EXPECT_EQ(answered(raw("three", "D500", numbers({1, 2, 3}))).detail,
            "commands.allow does not cover D500 to D502");
  EXPECT_EQ(
      answered(read("read", "", "D120")).detail,
      "commands.allow does not cover D120; the tag temp has this address: name the tag instead");
  EXPECT_EQ(answered(raw("scaled", "D200", number(5))).detail, "commands.allow does not cover D200")
      << "the tag would write another value";
  EXPECT_EQ(answered(raw("read only", "D120", number(5))).detail,
            "commands.allow does not cover D120");
}

TEST_F(CommandAdmissionTest, AddressIsCheckedBeforeTheAllowList) {
  EXPECT_EQ(answered(raw("octal", "X8", flag(true))).reason, Reason::bad_address);
  EXPECT_EQ(answered(raw("nonsense", "Q7", number(1))).reason, Reason::bad_address);
  EXPECT_EQ(answered(raw("too far", "D8000000", number(1))).reason, Reason::bad_address);
  EXPECT_EQ(answered(raw("wrong type", "D100", flag(true), DataType::boolean)).reason,
            Reason::bad_address);
}

TEST_F(CommandAdmissionTest, TimerNeedsATypeToBeToldApart) {
  const CommandResult result = answered(raw("b7e1", "T5", number(1)));
  EXPECT_EQ(result.reason, Reason::bad_address);
  EXPECT_EQ(result.detail,
            "T5 is both a contact and a value: write TS5 for the contact, TN5 for the value, or "
            "set type");
  EXPECT_EQ(admit(raw("value", "T5", number(1), DataType::int16)).targets[0].point.address.text,
            "TN5");
  EXPECT_EQ(
      admit(raw("contact", "T5", flag(true), DataType::boolean)).targets[0].point.address.text,
      "TS5");
}

TEST_F(CommandAdmissionTest, ForceIsForSingleBits) {
  EXPECT_EQ(answered(force("word", "D100")).reason, Reason::bad_address);
  device.tags.push_back(writable(array_of(tag(*device.codec, "lamps", "M200"), 8)));
  Command lamps = force("lamps", "");
  lamps.targets[0].tag = "lamps";
  EXPECT_EQ(answered(lamps).detail,
            "the tag lamps at M200 is not a single bit device: its count is 8");
  const AdmittedCommand admitted = admit(force("bit", "M100"));
  const auto frame = device.codec->encode(admitted.targets[0].requests.at(0), 0);
  EXPECT_EQ(to_hex(*frame), to_hex(force_frame(kForceM100, true)));
}

TEST_F(CommandAdmissionTest, WriteToABitIsAForce) {
  const AdmittedCommand admitted = admit(raw("b7e1", "M100", flag(false)));
  const auto frame = device.codec->encode(admitted.targets[0].requests.at(0), 0);
  EXPECT_EQ(to_hex(*frame), to_hex(force_frame(kForceM100, false)));
}

TEST_F(CommandAdmissionTest, BitOfAWordIsReadOnly) {
  EXPECT_EQ(answered(raw("b7e1", "D100.F", flag(true))).reason, Reason::not_writable);
}

TEST_F(CommandAdmissionTest, TagThatIsReadOnlyIsSaidToBeThatWhateverElseIsWrong) {
  device.tags.push_back(array_of(tag(*device.codec, "alarms", "M100"), 16));
  Command alarms = write("b7e1");
  alarms.targets[0] = {"alarms", "", std::nullopt, numbers({1})};
  const CommandResult result = answered(alarms);
  EXPECT_EQ(result.reason, Reason::not_writable);
  EXPECT_EQ(result.detail.find("the tag's access is read, and "), 0U)
      << result.detail << ": another access would not help";
}

TEST_F(CommandAdmissionTest, RunStopRelaysAreNeverWritten) {
  device.commands.allow.push_back({fx::id(fx::Space::special_m), 0, 256});
  for (const char* relay : {"M8034", "M8035", "M8036", "M8037", "M8118"})
    EXPECT_EQ(answered(raw(relay, relay, flag(true))).reason, Reason::not_writable) << relay;
  admit(raw("M8033", "M8033", flag(true)));
}

TEST_F(CommandAdmissionTest, ReadMayReadAnyTagAndOnlyAllowedAddresses) {
  admit(read("tag", "temp"));
  admit(read("allowed", "", "D100"));
  EXPECT_EQ(answered(read("raw", "", "D120")).reason, Reason::not_allowed);
  Command from_the_command_line = read("anything", "", "D120");
  from_the_command_line.any_address = true;
  admit(from_the_command_line);
}

TEST_F(CommandAdmissionTest, ReadHasNothingToWrite) {
  const AdmittedCommand admitted = admit(read("b7e1", "temp"));
  EXPECT_TRUE(admitted.targets[0].requests.empty());
  EXPECT_TRUE(admitted.targets[0].image.empty());
}

TEST_F(CommandAdmissionTest, RunAndStopNeedTheirRule) {
  EXPECT_EQ(answered(command("a", Op::run)).reason, Reason::not_allowed);
  EXPECT_EQ(answered(command("A", Op::stop)).reason, Reason::not_allowed);
  device.commands.allow_run_stop = true;
  const AdmittedCommand stop = admit(command("b", Op::stop));
  ASSERT_TRUE(stop.run_request);
  EXPECT_EQ(to_hex(*device.codec->encode(*stop.run_request, 0)),
            to_hex(force_frame(kForceM8037, true)));
  const AdmittedCommand run = admit(command("c", Op::run));
  EXPECT_EQ(to_hex(*device.codec->encode(*run.run_request, 0)),
            to_hex(force_frame(kForceM8037, false)));
}

TEST_F(CommandAdmissionTest, RunThatTheProtocolCannotSayToThisModelIsRefusedBeforeItIsSent) {
  device.commands.allow_run_stop = true;
  Options options = default_options(*find_protocol("mc-1e"));
  options["model"] = std::string("Q");
  device.codec = *find_protocol("mc-1e")->make(options);
  const CommandResult refused = answered(command("a", Op::run));
  EXPECT_EQ(refused.reason, Reason::bad_op);
  EXPECT_NE(refused.detail.find("use mc-3e"), std::string::npos) << refused.detail;
}

// ---- values ------------------------------------------------------------------------------------

TEST_F(CommandAdmissionTest, ValuesThatDoNotFit) {
  const auto reason = [&](const Command& command) {
    return std::string(to_string(answered(command).reason));
  };
  Command missing = write("missing");
  missing.targets[0].value.reset();
  EXPECT_EQ(reason(missing), "bad_value");
  Command wrong_kind = write("kind");
  wrong_kind.targets[0].value = text("fifty");
  EXPECT_EQ(reason(wrong_kind), "bad_value");
  EXPECT_EQ(reason(raw("word", "D100", number(40000))), "out_of_range");
  EXPECT_EQ(reason(raw("bit", "M100", number(2))), "bad_value");
  EXPECT_EQ(reason(write("below", -0.1)), "out_of_range");
  Command recipe = write("short");
  recipe.targets[0] = {"recipe", "", std::nullopt, numbers({1, 2})};
  EXPECT_EQ(reason(recipe), "bad_value");
}

TEST_F(CommandAdmissionTest, LimitsOfATagAreItsOwnAndTold) {
  admit(write("least", 0));
  admit(write("most", 100));
  const CommandResult result = answered(write("above", 100.1));
  EXPECT_EQ(result.reason, Reason::out_of_range);
  EXPECT_NE(result.detail.find("max of 100"), std::string::npos) << result.detail;
  const CommandResult far_above = answered(write("beyond int16", 5500));
  EXPECT_EQ(far_above.reason, Reason::out_of_range);
  EXPECT_EQ(far_above.detail, "5500 would be written, above the tag's max of 100");
}

TEST_F(CommandAdmissionTest, LimitsOfATagBindEachElement) {
  device.tags.back().units =
      std::make_shared<const TagUnits>(TagUnits{.limits = {.min = 0.0, .max = 100.0}});
  const auto recipe = [&](std::string id, std::int64_t last) {
    Command command = write(std::move(id));
    command.targets[0] = {"recipe", "", std::nullopt, numbers({1, 2, last})};
    return command;
  };
  admit(recipe("most", 100));
  EXPECT_EQ(answered(recipe("above", 101)).reason, Reason::out_of_range);
}

// The raw step is 40: the step nearest to 100 is 120.
TEST_F(CommandAdmissionTest, LimitsBindWhatIsReallyWritten) {
  device.tags.push_back(writable(scaled(tag(*device.codec, "coarse", "D260"), 40)));
  device.tags.back().units =
      std::make_shared<const TagUnits>(TagUnits{.limits = {.min = -100.0, .max = 100.0}});
  const auto coarse = [&](std::string id, double value, bool dry_run = false) {
    Command command = write(std::move(id), value);
    command.targets[0].tag = "coarse";
    command.dry_run = dry_run;
    return command;
  };
  for (const double value : {100.0, -100.0}) {
    const CommandResult result = answered(coarse("a" + std::to_string(value), value));
    EXPECT_EQ(to_string(result.reason), "out_of_range");
    EXPECT_NE(result.detail.find("120"), std::string::npos) << result.detail;
    EXPECT_EQ(to_string(answered(coarse("dry", value, true)).reason), "out_of_range");
  }
  // A requested value may exceed the limit if the written value does not.
  const AdmittedCommand admitted = admit(coarse("b", 99));
  EXPECT_EQ(admitted.targets[0].written, real(80));
  Command above = write("c", 100.04);
  EXPECT_EQ(admit(above).targets[0].written, real(100));
}

// As float32 with this scale and offset, 0 is -0.0000022, and 100 is 100.000004.
TEST_F(CommandAdmissionTest, ScaledFloatMayBeEqualToItsLimit) {
  TagConfig oil = writable(tag(*device.codec, "oil", "D260"));
  oil.point.type = DataType::float32;
  ASSERT_TRUE(set_units(oil.point, 1.8, 32));
  oil.units = std::make_shared<const TagUnits>(TagUnits{.limits = {.min = 0.0, .max = 100.0}});
  device.tags.push_back(oil);
  for (const double value : {0.0, 100.0})
    admit(write_to("oil", "at" + std::to_string(value), value));
  for (const double value : {-0.0001, 100.0001})
    EXPECT_EQ(to_string(answered(write_to("oil", "beyond" + std::to_string(value), value)).reason),
              "out_of_range");
}

// 27648 of the device is 250.00000000000003 with this scale and offset.
TEST_F(CommandAdmissionTest, ScaledIntegerMayBeEqualToItsLimit) {
  TagConfig press = writable(tag(*device.codec, "press", "D260"));
  const double scale = 250.0 / (27648 - 5530);
  ASSERT_TRUE(set_units(press.point, scale, -5530 * scale));
  press.units = std::make_shared<const TagUnits>(TagUnits{.limits = {.min = 0.0, .max = 250.0}});
  device.tags.push_back(press);
  for (const double value : {0.0, 250.0})
    admit(write_to("press", "at" + std::to_string(value), value));
  for (const double value : {-scale, 250 + scale})
    EXPECT_EQ(
        to_string(answered(write_to("press", "beyond" + std::to_string(value), value)).reason),
        "out_of_range");
}

TEST_F(CommandAdmissionTest, LimitsOf64BitsAreComparedExactly) {
  TagConfig energy = writable(tag(*device.codec, "energy", "D260"));
  energy.point.type = DataType::int64;
  energy.units = std::make_shared<const TagUnits>(TagUnits{.limits = {.max = 9007199254740992.0}});
  device.tags.push_back(energy);
  const auto with = [&](std::string id, Value value) {
    Command command = write(std::move(id));
    command.targets[0].tag = "energy";
    command.targets[0].value = std::move(value);
    return command;
  };
  EXPECT_EQ(admit(with("a", Value(std::int64_t{9007199254740992}))).targets[0].written,
            Value(std::int64_t{9007199254740992}));
  const CommandResult above = answered(with("b", Value(std::string("9007199254740993"))));
  EXPECT_EQ(to_string(above.reason), "out_of_range");
  EXPECT_EQ(above.detail,
            "9007199254740993 would be written, above the tag's max of 9007199254740992");
}

TEST_F(CommandAdmissionTest, ALimitOnOneSideHoldsThatSide) {
  const auto with = [&](std::string name, TagLimits limits) {
    TagConfig one = writable(tag(*device.codec, name, "D260"));
    one.units = std::make_shared<const TagUnits>(TagUnits{.limits = limits});
    device.tags.push_back(one);
    return [this, name, n = 0](double value) mutable {
      Command command = write(name + std::to_string(n++));
      command.targets[0].tag = name;
      command.targets[0].value = real(value);
      return admission.admit(command, device.codec, 0, now);
    };
  };
  auto from_ten = with("from_ten", {.min = 10});
  EXPECT_TRUE(std::holds_alternative<CommandResult>(from_ten(9)));
  EXPECT_TRUE(std::holds_alternative<AdmittedCommand>(from_ten(10)));
  auto to_ten = with("to_ten", {.max = 10});
  EXPECT_TRUE(std::holds_alternative<CommandResult>(to_ten(11)));
  EXPECT_TRUE(std::holds_alternative<AdmittedCommand>(to_ten(10)));
}

TEST_F(CommandAdmissionTest, ExpectIsKeptAsItCame) {
  Command command = write("b7e1");
  command.expect = real(45);
  EXPECT_EQ(admit(command).targets[0].expected, real(45));
}

TEST_F(CommandAdmissionTest, ExpectOfTheWrongKindIsRefused) {
  int sent = 0;
  const auto expecting = [&](std::string name, Value expect) {
    Command command = write("b7e" + std::to_string(++sent));
    command.targets[0].tag = name;
    if (name == "name") command.targets[0].value = text("abc");
    if (name == "recipe") command.targets[0].value = numbers({1, 2, 3});
    command.expect = std::move(expect);
    return answered(command);
  };
  for (const auto& [name, expect] :
       std::vector<std::pair<std::string, Value>>{{"setpoint", text("forty-five")},
                                                  {"setpoint", numbers({45})},
                                                  {"setpoint", flag(true)},
                                                  {"name", number(1)},
                                                  {"recipe", numbers({1, 2})},
                                                  {"recipe", number(1)}})
    EXPECT_EQ(to_string(expecting(name, expect).reason), "bad_value") << name;
  Command forced = force("on", "M100");
  forced.expect = text("on");
  EXPECT_EQ(answered(forced).reason, Reason::bad_value);
}

// The agent still reads the device, and the result reports its value.
TEST_F(CommandAdmissionTest, ExpectThatTheTagCannotShowIsNoReasonToRefuse) {
  for (const double never : {45.04, 1e9, -5000.0}) {
    Command command = write("number " + std::to_string(never));
    command.expect = real(never);
    admit(command);
  }
  for (const char* const never : {"longer than the tag", "\xE4\xB8\xAD"}) {
    Command command = write(std::string("text ") + (never[0] == 'l' ? "a" : "b"));
    command.targets[0] = {"name", "", std::nullopt, text("abc")};
    command.expect = text(never);
    admit(command);
  }
}

TEST_F(CommandAdmissionTest, ExpectThatIsWrongComesBeforeAValueOutOfRange) {
  Command command = write("b7e1", 100000);
  command.expect = text("forty-five");
  EXPECT_EQ(answered(command).reason, Reason::bad_value);
}

TEST_F(CommandAdmissionTest, VerifyIsTheCommandsThenTheRulesAndBitsOnlyOnDemand) {
  const AdmittedCommand by_rule = admit(write("a"));
  EXPECT_TRUE(by_rule.verify_words);
  EXPECT_FALSE(by_rule.verify_bits);
  Command demanded = raw("b", "M100", flag(true));
  demanded.verify = true;
  EXPECT_TRUE(admit(demanded).verify_bits);
  Command waived = write("c");
  waived.verify = false;
  EXPECT_FALSE(admit(waived).verify_words);
  device.commands.verify = false;
  EXPECT_FALSE(admit(write("d")).verify_words);
}

TEST_F(CommandAdmissionTest, BroadcastCannotBeExpectedToHoldAValue) {
  DeviceConfig all = device_on("modbus-rtu", codec_of("modbus-rtu", {{"unit", std::int64_t{0}}}));
  all.commands.allow.push_back(*all.codec->addresses().parse_range("hr:1"));
  CommandAdmission of_all{all};
  Command command = raw("a", "hr:1", number(5));
  EXPECT_TRUE(std::holds_alternative<AdmittedCommand>(of_all.admit(command, all.codec, 0, now)));
  command.id = "b";
  command.expect = number(4);
  const auto decision = of_all.admit(command, all.codec, 0, now);
  ASSERT_TRUE(std::holds_alternative<CommandResult>(decision));
  const auto& result = std::get<CommandResult>(decision);
  EXPECT_EQ(result.status, CommandStatus::rejected);
  EXPECT_EQ(result.reason, Reason::bad_value);
  EXPECT_EQ(result.detail, "expect: no device answers a broadcast, so there is nothing to compare");
}

// ---- lists -------------------------------------------------------------------------------------

TEST_F(CommandAdmissionTest, ListIsAdmittedWhole) {
  Command list = write("b7e1");
  list.is_list = true;
  list.targets.push_back({"start", "", std::nullopt, flag(true)});
  list.targets.push_back({"", "D100", std::nullopt, number(7)});
  const AdmittedCommand admitted = admit(list);
  ASSERT_EQ(admitted.targets.size(), 3U);
  EXPECT_EQ(admitted.targets[2].point.address.text, "D100");
}

TEST_F(CommandAdmissionTest, OneRefusedTargetRefusesTheList) {
  Command list = write("b7e1");
  list.is_list = true;
  list.targets.push_back({"temp", "", std::nullopt, number(1)});
  list.targets.push_back({"start", "", std::nullopt, flag(true)});
  const CommandResult result = answered(list);
  EXPECT_EQ(result.status, CommandStatus::rejected);
  EXPECT_EQ(result.reason, Reason::not_writable);
  ASSERT_EQ(result.targets.size(), 3U);
  EXPECT_EQ(result.targets[0].reason, Reason::none);
  EXPECT_EQ(result.targets[0].status, CommandStatus::rejected);
  EXPECT_EQ(result.targets[1].reason, Reason::not_writable);
  EXPECT_EQ(result.targets[2].status, CommandStatus::rejected);
}

// A target with REJECTED would promise that nothing was done, contrary to the result around it.
TEST_F(CommandAdmissionTest, WhatBecameOfAListBecameOfEachOfItsTargets) {
  Command list = write("b7e1");
  list.is_list = true;
  list.targets.push_back({"start", "", std::nullopt, flag(true)});
  const auto statuses = [](const CommandResult& result) {
    std::set<CommandStatus> all{result.status};
    for (const TargetResult& target : result.targets) all.insert(target.status);
    return all;
  };
  list.dry_run = true;
  EXPECT_EQ(statuses(answered(list)), std::set{CommandStatus::succeeded});
  list.dry_run = false;
  list.message_expiry = std::chrono::seconds(1);
  list.received = now - std::chrono::seconds(2);
  EXPECT_EQ(statuses(answered(list)), std::set{CommandStatus::expired});
  EXPECT_EQ(statuses(answered(list)), std::set{CommandStatus::duplicate});
}

TEST_F(CommandAdmissionTest, ForcesAreListedToo) {
  Command list = force("b7e1", "M100");
  list.is_list = true;
  list.targets.push_back({"start", "", std::nullopt, std::nullopt});
  const AdmittedCommand admitted = admit(list);
  ASSERT_EQ(admitted.targets.size(), 2U);
  EXPECT_EQ(admitted.targets[1].written, flag(true));
  list.id = "b7e2";
  list.targets.push_back({"setpoint", "", std::nullopt, std::nullopt});
  const CommandResult result = answered(list);
  EXPECT_EQ(result.reason, Reason::bad_address);
  EXPECT_EQ(result.targets.at(2).reason, Reason::bad_address);
  for (const TargetResult& target : result.targets) EXPECT_EQ(target.value, flag(true));
}

TEST_F(CommandAdmissionTest, CommandThatIsNotSentHasTheAddressAndTheValueToBeWritten) {
  const CommandResult result = not_sent(admit(write("b7e1", 50.04)), Reason::yielded);
  EXPECT_EQ(result.status, CommandStatus::rejected);
  ASSERT_EQ(result.targets.size(), 1U);
  EXPECT_EQ(result.targets[0].tag, "setpoint");
  EXPECT_EQ(result.targets[0].address, "D200");
  EXPECT_EQ(result.targets[0].value, real(50));
  EXPECT_EQ(result.targets[0].reason, Reason::yielded);
}

// The checks run in the contract's order over all targets, not target by target.
TEST_F(CommandAdmissionTest, OfSeveralFaultyTargetsTheFirstCheckDecides) {
  Command list = write("b7e1", 500);
  list.is_list = true;
  list.targets.push_back({"start", "", std::nullopt, text("on")});
  list.targets.push_back({"", "D101", std::nullopt, number(1)});
  list.targets.push_back({"temp", "", std::nullopt, number(1)});
  list.targets.push_back({"presure", "", std::nullopt, number(1)});
  list.targets.push_back({"", "Q7", std::nullopt, number(1)});
  const std::vector<std::string> reasons{"out_of_range", "bad_value",   "not_allowed",
                                         "not_writable", "unknown_tag", "bad_address"};
  const std::vector<std::string> of_the_first{"out_of_range", "bad_value",   "not_allowed",
                                              "not_allowed",  "unknown_tag", "unknown_tag"};
  for (std::size_t most = 1; most <= list.targets.size(); ++most) {
    Command command = list;
    command.id = std::to_string(most);
    command.targets.resize(most);
    const CommandResult result = answered(command);
    EXPECT_EQ(to_string(result.reason), of_the_first[most - 1]);
    for (std::size_t i = 0; i < most; ++i)
      EXPECT_EQ(to_string(result.targets.at(i).reason), reasons[i]);
  }
}

TEST_F(CommandAdmissionTest, FaultOfAValueIsToldAtItsTarget) {
  const auto parsed = [&](std::string_view payload) {
    return answered(stamped(parse_command(payload)));
  };
  const CommandResult one = parsed(R"({"id":"1","op":"write","tag":"recipe","value":[1,2,null]})");
  EXPECT_EQ(one.reason, Reason::bad_value);
  test::expect_says(one.detail, "element 3 of value is null");
  const CommandResult list = parsed(
      R"({"id":"2","op":"write","targets":[{"tag":"setpoint","value":5},{"tag":"start","value":null},
          {"value":1},{"tag":"setpoint"}]})");
  EXPECT_EQ(list.reason, Reason::unknown_tag);
  ASSERT_EQ(list.targets.size(), 4U);
  EXPECT_EQ(list.targets[0].reason, Reason::none);
  test::expect_says(list.targets[1].detail, "value is null");
  EXPECT_EQ(list.targets[2].detail, "neither tag nor address");
  EXPECT_EQ(list.targets[3].detail, "value is missing");
}

TEST_F(CommandAdmissionTest, ReadByAddressBringsAsManyAsItsCount) {
  const auto parsed = [&](std::string_view payload) {
    return admit(stamped(parse_command(payload))).targets.at(0).point;
  };
  const Point two = parsed(R"({"id":"1","op":"read","address":"D500","count":2})");
  EXPECT_TRUE(two.is_array);
  EXPECT_EQ(two.count, 2);
  EXPECT_FALSE(parsed(R"({"id":"2","op":"read","address":"D500","count":1})").is_array);
  const Point name =
      parsed(R"({"id":"3","op":"read","address":"D500","type":"string","length":3})");
  EXPECT_EQ(name.length, 3);
  EXPECT_FALSE(name.is_array);
  const CommandResult beyond =
      answered(stamped(parse_command(R"({"id":"4","op":"read","address":"D500","count":3})")));
  EXPECT_EQ(beyond.reason, Reason::not_allowed);
}

TEST_F(CommandAdmissionTest, TextAtAnAddressIsAsLongAsItsCharacters) {
  const AdmittedCommand admitted =
      admit(raw("b7e1", "D500", text("\u00E4\u00F6\u00FC"), DataType::string));
  EXPECT_EQ(admitted.targets[0].point.length, 3) << "characters, not the bytes of UTF-8";
}

TEST_F(CommandAdmissionTest, CommandWithoutATargetHasNoPlace) {
  Command nowhere = write("b7e1");
  nowhere.targets.clear();
  EXPECT_EQ(answered(nowhere).reason, Reason::unknown_tag);
}

}  // namespace
}  // namespace fxagent::test
