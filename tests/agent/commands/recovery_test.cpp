#include "agent/commands/recovery.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "agent/store/store.h"
#include "tests/agent/uplink/plant.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

constexpr std::int64_t kNow = 1790000000000;
const SteadyTime kStart{std::chrono::hours(1)};

struct RecoveryTest : ::testing::Test {
  RecoveryTest() {
    settings.path = scratch.path("store");
    store = std::make_unique<Store>(settings, kNow);
  }

  /// A journal entry of a press1 command without a result.
  static JournalEntry order(const std::string& id, std::uint64_t number, std::string payload = {}) {
    JournalEntry made;
    made.device = "press1";
    made.id = id;
    made.received_ms = kNow;
    made.deadline_ms = kNow + 10000;
    made.op = "write";
    made.number = number;
    made.payload = std::move(payload);
    return made;
  }

  Recovered take_late(std::vector<JournalEntry> unacknowledged) {
    return recover(config, store->journal(), {}, std::move(unacknowledged), kNow, kStart);
  }

  /// Returns the result of an interrupted command; `rest` is the rest of its JSON object after
  /// `op`.
  nlohmann::json result_of_unfinished(const std::string& op, const std::string& rest,
                                      bool surely_not_sent) {
    JournalEntry left = order("left", 5, R"({"id":"left","op":")" + op + "\"" + rest + "}");
    left.op = op;
    left.surely_not_sent = surely_not_sent;
    const Recovered found = take_late({left});
    EXPECT_TRUE(found.interrupted.empty());
    if (found.unacknowledged.size() != 1) return nullptr;
    return nlohmann::json::parse(found.unacknowledged[0].recorded);
  }

  Config config = test::plant();
  test::Scratch scratch;
  StoreConfig settings;
  std::unique_ptr<Store> store;
};

TEST_F(RecoveryTest, InterruptedCommandIsReadBackByItsOwnPayload) {
  const std::string payload = R"({"id":"mine","op":"write","tag":"setpoint","value":5})";
  ASSERT_TRUE(store->journal().journal(std::vector{order("mine", 1, payload)}));
  const Recovered found = recover(config, store->journal(), kNow, kStart);
  ASSERT_EQ(found.interrupted.size(), 1U);
  EXPECT_EQ(found.interrupted[0].command.id, "mine");
  EXPECT_EQ(found.interrupted[0].command.number, 1U);
  EXPECT_TRUE(found.unacknowledged.empty());
}

TEST_F(RecoveryTest, NewerEntryReplacesThatOfTheJournalAndMakesItsIdKnown) {
  ASSERT_TRUE(store->journal().journal(std::vector{order("mine", 1), order("answered", 2)}));
  JournalEntry answered = order("answered", 2);
  answered.result = "{}";
  answered.acknowledged = true;
  JournalEntry heard = order("heard", 3);
  heard.acknowledged = true;
  const Recovered found = recover(config, store->journal(), kNow, kStart, {answered, heard});
  ASSERT_EQ(found.unacknowledged.size(), 1U);
  EXPECT_EQ(found.unacknowledged[0].id, "mine");
  EXPECT_TRUE(std::ranges::any_of(found.ids, [](const KnownId& id) { return id.id == "heard"; }));
}

TEST_F(RecoveryTest, CommandThatTheOtherGatewayLeftGetsItsResultAndIsKnown) {
  const auto take = [&](JournalEntry left) {
    return recover_unanswered(config, store->journal(), std::move(left), "a/topic", kNow, kStart);
  };
  JournalEntry unsent = order("unsent", 0);
  unsent.surely_not_sent = true;
  JournalEntry done = order("done", 0);
  done.result = R"({"id":"done","op":"write","status":"FAILED"})";
  JournalEntry elsewhere = order("elsewhere", 0);
  elsewhere.device = "press9";
  EXPECT_EQ(take(unsent).unacknowledged.at(0).status, CommandStatus::failed);
  EXPECT_EQ(take(done).unacknowledged.at(0).recorded, done.result);
  EXPECT_TRUE(take(elsewhere).unacknowledged.empty());
  for (const JournalEntry& again : {unsent, done}) {
    const auto known = store->journal().find("press1", again.id);
    ASSERT_TRUE(known) << again.id;
    EXPECT_NE(known->result, "");
  }
}

// Otherwise its id would be remembered for longer, and its deadline would move away.
TEST_F(RecoveryTest, InterruptedCommandIsNotYoungerAfterTheClockWasSetBack) {
  const std::string payload = R"({"id":"mine","op":"write","tag":"setpoint","value":5})";
  ASSERT_TRUE(store->journal().journal(std::vector{order("mine", 1, payload)}));
  const Recovered found = recover(config, store->journal(), kNow - 3'600'000, kStart);
  ASSERT_EQ(found.interrupted.size(), 1U);
  EXPECT_EQ(found.interrupted[0].command.received, kStart);
}

// The payload of another command must not be used: a matching read-back would report SUCCEEDED for
// a command that was never sent.
TEST_F(RecoveryTest, PayloadOfAnotherCommandIsNotTakenForTheInterruptedOne) {
  const std::string payload = R"({"id":"other","op":"write","tag":"setpoint","value":5})";
  ASSERT_TRUE(store->journal().journal(std::vector{order("mine", 1, payload)}));
  const Recovered found = recover(config, store->journal(), kNow, kStart);
  EXPECT_TRUE(found.interrupted.empty());
  ASSERT_EQ(found.unacknowledged.size(), 1U);
  EXPECT_EQ(found.unacknowledged[0].id, "mine");
  EXPECT_EQ(found.unacknowledged[0].status, CommandStatus::unknown_outcome);
}

TEST_F(RecoveryTest, WriteThatWaitedFailedAtOnceAndIsNotReadBack) {
  const auto result = result_of_unfinished("write", R"(,"tag":"setpoint","value":5)", true);
  EXPECT_EQ(result["status"], "FAILED");
  EXPECT_EQ(result["reason"], "interrupted");
  EXPECT_EQ(result["detail"], "the agent ended before anything was written");
  EXPECT_EQ(result["plc"], nullptr);
  EXPECT_EQ(result["tag"], "setpoint");
  EXPECT_EQ(result["value"], 5);
  const auto kept = store->journal().find("press1", "left");
  ASSERT_TRUE(kept);
  EXPECT_EQ(nlohmann::json::parse(kept->result), result);
}

TEST_F(RecoveryTest, EachTargetOfAListThatWaitedFailed) {
  const auto result = result_of_unfinished(
      "write", R"(,"targets":[{"tag":"setpoint","value":5},{"tag":"level","value":1}])", true);
  EXPECT_EQ(result["status"], "FAILED");
  ASSERT_EQ(result["targets"].size(), 2U);
  for (const auto& target : result["targets"]) {
    EXPECT_EQ(target["status"], "FAILED");
    EXPECT_EQ(target["reason"], "interrupted");
  }
}

TEST_F(RecoveryTest, ForceRunAndStopThatWaitedFailedAndThoseThatMayHaveLeftAreUnknown) {
  for (const auto& [op, rest] :
       {std::pair("force_on", R"(,"tag":"running")"), std::pair("force_off", R"(,"tag":"running")"),
        std::pair("run", ""), std::pair("stop", "")}) {
    SCOPED_TRACE(op);
    for (const bool surely_not_sent : {true, false}) {
      const auto result = result_of_unfinished(op, rest, surely_not_sent);
      EXPECT_EQ(result["status"], surely_not_sent ? "FAILED" : "UNKNOWN_OUTCOME");
      EXPECT_EQ(result["reason"], "interrupted");
      // Uses another store, because the first result of an id is kept.
      settings.path = scratch.path(std::string(op) + (surely_not_sent ? "-again" : "-next"));
      store = std::make_unique<Store>(settings, kNow);
    }
  }
}

TEST_F(RecoveryTest, ReadFailedWhetherItWaitedOrNot) {
  const auto result = result_of_unfinished("read", R"(,"tag":"temp")", false);
  EXPECT_EQ(result["status"], "FAILED");
  EXPECT_EQ(result["reason"], "interrupted");
  EXPECT_EQ(result["detail"], "the agent ended before the device was read");
}

TEST_F(RecoveryTest, CommandOfAnOlderJournalWithoutItsPayloadHasItsResultToo) {
  JournalEntry left = order("left", 5);
  left.surely_not_sent = true;
  const Recovered found = take_late({left});
  ASSERT_EQ(found.unacknowledged.size(), 1U);
  EXPECT_EQ(found.unacknowledged[0].status, CommandStatus::failed);
}

TEST_F(RecoveryTest, StoreThatOpensLateLeavesThisRunsNewerCommandAlone) {
  ASSERT_TRUE(store->journal().journal(std::vector{order("again", 9)}));
  const Recovered found = take_late({order("again", 5)});
  EXPECT_TRUE(found.unacknowledged.empty());
  EXPECT_TRUE(found.interrupted.empty());
  EXPECT_TRUE(found.ids.empty());
  EXPECT_EQ(store->journal().find("press1", "again")->result, "");  // still in progress
}

// If the clock began in the past, this run has the lower numbers.
TEST_F(RecoveryTest, StoreThatOpensLateKeepsTheResultThatThisRunHas) {
  JournalEntry done = order("again", 3);
  done.result = R"({"id":"again","status":"SUCCEEDED"})";
  store->journal().record(done);
  const Recovered found = take_late({order("again", 5)});
  EXPECT_TRUE(found.unacknowledged.empty());
  EXPECT_EQ(store->journal().find("press1", "again")->result, done.result);
}

TEST_F(RecoveryTest, StoreThatOpensLateTellsOfAnOlderCommand) {
  ASSERT_TRUE(store->journal().journal(std::vector{order("old", 5)}));
  const Recovered found = take_late({order("old", 5)});
  ASSERT_EQ(found.unacknowledged.size(), 1U);
  EXPECT_EQ(found.unacknowledged[0].status, CommandStatus::unknown_outcome);
}

}  // namespace
}  // namespace fxagent
