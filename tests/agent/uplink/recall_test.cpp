#include "agent/uplink/recall.h"

#include <gtest/gtest.h>

#include <memory>

#include "tests/agent/uplink/plant.h"
#include "tests/agent/uplink/scratch.h"

namespace fxagent {
namespace {

constexpr std::int64_t kNow = 1790000000000;
const SteadyTime kStart{std::chrono::hours(1)};

struct RecallTest : ::testing::Test {
  RecallTest() {
    settings.path = scratch.path("store");
    store = std::make_unique<Store>(settings, kNow);
  }

  /// An order of press1 without a result, as it is in the journal.
  static JournalEntry order(const std::string& id, std::uint64_t arrival,
                            std::string payload = {}) {
    JournalEntry made;
    made.device = "press1";
    made.id = id;
    made.received_ms = kNow;
    made.deadline_ms = kNow + 10000;
    made.op = "write";
    made.arrival = arrival;
    made.payload = std::move(payload);
    return made;
  }

  Recall take_late(std::vector<JournalEntry> unsettled) {
    Store::FoundLate late;
    late.unsettled = std::move(unsettled);
    return recall(config, *store, std::move(late), kNow, kStart);
  }

  Config config = test::plant();
  test::Scratch scratch;
  StoreConfig settings;
  std::unique_ptr<Store> store;
};

TEST_F(RecallTest, OrderIsReadBackByItsOwnPayload) {
  const std::string payload = R"({"id":"mine","op":"write","tag":"setpoint","value":5})";
  ASSERT_TRUE(store->journal(std::vector{order("mine", 1, payload)}));
  const Recall found = recall(config, store.get(), kNow, kStart);
  ASSERT_EQ(found.field.left_behind.size(), 1U);
  EXPECT_EQ(found.field.left_behind[0].id, "mine");
  EXPECT_EQ(found.field.left_behind[0].arrival, 1U);
  EXPECT_TRUE(found.untold.empty());
}

// What another command was to write says nothing about this one: a read-back that happens to agree
// would make a SUCCEEDED of an order that never left.
TEST_F(RecallTest, PayloadOfAnotherCommandIsNotTakenForTheOrder) {
  const std::string payload = R"({"id":"other","op":"write","tag":"setpoint","value":5})";
  ASSERT_TRUE(store->journal(std::vector{order("mine", 1, payload)}));
  const Recall found = recall(config, store.get(), kNow, kStart);
  EXPECT_TRUE(found.field.left_behind.empty());
  ASSERT_EQ(found.untold.size(), 1U);
  EXPECT_EQ(found.untold[0].id, "mine");
  EXPECT_EQ(found.untold[0].status, CommandStatus::unknown_outcome);
}

TEST_F(RecallTest, StoreThatOpensLateLeavesThisRunsNewerOrderAlone) {
  ASSERT_TRUE(store->journal(std::vector{order("again", 9)}));
  const Recall found = take_late({order("again", 5)});
  EXPECT_TRUE(found.untold.empty());
  EXPECT_TRUE(found.field.left_behind.empty());
  EXPECT_TRUE(found.field.ids.empty());
  EXPECT_EQ(store->find("press1", "again")->result, "");  // it is still under way
}

// With a clock that began in the past this run's numbers are the lower ones.
TEST_F(RecallTest, StoreThatOpensLateKeepsTheResultThatThisRunHas) {
  JournalEntry done = order("again", 3);
  done.result = R"({"id":"again","status":"SUCCEEDED"})";
  store->record(done);
  const Recall found = take_late({order("again", 5)});
  EXPECT_TRUE(found.untold.empty());
  EXPECT_EQ(store->find("press1", "again")->result, done.result);
}

TEST_F(RecallTest, StoreThatOpensLateTellsOfAnOlderOrder) {
  ASSERT_TRUE(store->journal(std::vector{order("old", 5)}));
  const Recall found = take_late({order("old", 5)});
  ASSERT_EQ(found.untold.size(), 1U);
  EXPECT_EQ(found.untold[0].status, CommandStatus::unknown_outcome);
}

}  // namespace
}  // namespace fxagent
