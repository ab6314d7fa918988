#include "agent/commands/recovery.h"

#include <gtest/gtest.h>

#include <memory>

#include "agent/store/store.h"
#include "tests/agent/store/scratch.h"
#include "tests/agent/uplink/plant.h"

namespace fxagent {
namespace {

constexpr std::int64_t kNow = 1790000000000;
const SteadyTime kStart{std::chrono::hours(1)};

struct RecoveryTest : ::testing::Test {
  RecoveryTest() {
    settings.path = scratch.path("store");
    store = std::make_unique<Store>(settings, kNow);
  }

  /// An order of press1 without a result, as it is in the journal.
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

  Config config = test::plant();
  test::Scratch scratch;
  StoreConfig settings;
  std::unique_ptr<Store> store;
};

TEST_F(RecoveryTest, OrderIsReadBackByItsOwnPayload) {
  const std::string payload = R"({"id":"mine","op":"write","tag":"setpoint","value":5})";
  ASSERT_TRUE(store->journal().journal(std::vector{order("mine", 1, payload)}));
  const Recovered found = recover(config, store->journal(), kNow, kStart);
  ASSERT_EQ(found.interrupted.size(), 1U);
  EXPECT_EQ(found.interrupted[0].id, "mine");
  EXPECT_EQ(found.interrupted[0].number, 1U);
  EXPECT_TRUE(found.unacknowledged.empty());
}

// What another command was to write says nothing about this one: a read-back that happens to agree
// would make a SUCCEEDED of a command that never left.
TEST_F(RecoveryTest, PayloadOfAnotherCommandIsNotTakenForTheOrder) {
  const std::string payload = R"({"id":"other","op":"write","tag":"setpoint","value":5})";
  ASSERT_TRUE(store->journal().journal(std::vector{order("mine", 1, payload)}));
  const Recovered found = recover(config, store->journal(), kNow, kStart);
  EXPECT_TRUE(found.interrupted.empty());
  ASSERT_EQ(found.unacknowledged.size(), 1U);
  EXPECT_EQ(found.unacknowledged[0].id, "mine");
  EXPECT_EQ(found.unacknowledged[0].status, CommandStatus::unknown_outcome);
}

TEST_F(RecoveryTest, StoreThatOpensLateLeavesThisRunsNewerOrderAlone) {
  ASSERT_TRUE(store->journal().journal(std::vector{order("again", 9)}));
  const Recovered found = take_late({order("again", 5)});
  EXPECT_TRUE(found.unacknowledged.empty());
  EXPECT_TRUE(found.interrupted.empty());
  EXPECT_TRUE(found.ids.empty());
  EXPECT_EQ(store->journal().find("press1", "again")->result, "");  // it is still under way
}

// With a clock that began in the past this run's numbers are the lower ones.
TEST_F(RecoveryTest, StoreThatOpensLateKeepsTheResultThatThisRunHas) {
  JournalEntry done = order("again", 3);
  done.result = R"({"id":"again","status":"SUCCEEDED"})";
  store->journal().record(done);
  const Recovered found = take_late({order("again", 5)});
  EXPECT_TRUE(found.unacknowledged.empty());
  EXPECT_EQ(store->journal().find("press1", "again")->result, done.result);
}

TEST_F(RecoveryTest, StoreThatOpensLateTellsOfAnOlderOrder) {
  ASSERT_TRUE(store->journal().journal(std::vector{order("old", 5)}));
  const Recovered found = take_late({order("old", 5)});
  ASSERT_EQ(found.unacknowledged.size(), 1U);
  EXPECT_EQ(found.unacknowledged[0].status, CommandStatus::unknown_outcome);
}

}  // namespace
}  // namespace fxagent
