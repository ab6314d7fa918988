// The store on a disk that hangs: the calls refused, the calls delayed, and the place of each
// sample.
#include "agent/store/guarded_store.h"

#include <gtest/gtest.h>

#include <semaphore>

#include "tests/agent/store/power_cut.h"
#include "tests/agent/store/shelf.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using test::entry;
using test::kNow;
using test::kStart;
using test::rows;

struct GuardedStoreTest : ::testing::Test {
  GuardedStoreTest() { store.set_patience(1h); }

  Store& inside() { return *shelf.store; }
  void freeze() {
    frost.emplace(disk);
    store.set_patience(1ms);
  }
  /// The disk works again, and the store finishes its pending work.
  void thaw() {
    store.set_patience(1h);
    frost.reset();
    answered.acquire();
    store.upkeep(kStart, kNow);
    EXPECT_FALSE(store.hangs());
  }
  std::uint64_t stored() const { return store.figures().rows; }

  test::PowerCut disk;
  test::Shelf shelf;
  std::counting_semaphore<64> answered{0};
  GuardedStore store{shelf.open(), [this] { answered.release(); }};
  std::optional<test::Frost> frost;  ///< destroyed before the store
};

/// The rows that are returned, and the number of calls.
struct Outcome {
  std::vector<SampleRow> given;
  std::vector<bool> calls;
  GuardedSamples::Stored take() {
    return [this](std::vector<SampleRow> back, bool on_disk) {
      given = std::move(back);
      calls.push_back(on_disk);
    };
  }
};

TEST_F(GuardedStoreTest, DiskThatAnswersIsUsedAsWithoutTheGuard) {
  Outcome outcome;
  store.samples().append(rows(1, 3), outcome.take());
  EXPECT_EQ(outcome.calls, std::vector{true});
  EXPECT_EQ(stored(), 3U);
  auto held = rows(4, 5);
  EXPECT_TRUE(store.samples().hold(held));
  EXPECT_NE(held[0].row_id, 0U);
  EXPECT_TRUE(store.journal().journal(std::vector{entry("a")}));
  EXPECT_TRUE(store.journal().find("a", "a"));
  EXPECT_EQ(store.state(), "disk");
  const auto batch = store.samples().next(std::make_shared<test::JsonHistory>(65536), test::any);
  ASSERT_TRUE(batch);
  EXPECT_EQ(batch->row_ids.size(), 3U);
  std::uint64_t removed = 0;
  store.samples().remove(*batch, [&](std::uint64_t count) { removed = count; });
  EXPECT_EQ(removed, 3U);
}

TEST_F(GuardedStoreTest, StreamOfDamagedRowsAloneHoldsNoOtherUp) {
  Outcome outcome;
  auto damaged = rows(1, 3);
  for (SampleRow& row : damaged) row.content = "{";
  store.samples().append(std::move(damaged), outcome.take());
  store.samples().append(rows(1, 1, "b"), outcome.take());
  const auto batch = store.samples().next(std::make_shared<test::JsonHistory>(65536), test::any);
  ASSERT_TRUE(batch);
  EXPECT_EQ(batch->stream.device, "b");
}

TEST_F(GuardedStoreTest, OverdueSamplesAreInOnePlaceAtATime) {
  Outcome first;
  Outcome second;
  freeze();
  store.samples().append(rows(1, 3), first.take());
  EXPECT_TRUE(store.hangs());
  EXPECT_EQ(store.state(), "hangs");
  EXPECT_FALSE(store.is_writable());
  EXPECT_TRUE(first.calls.empty());
  EXPECT_EQ(store.samples().at_disk(), 3U);
  EXPECT_EQ(stored(), 0U);
  EXPECT_TRUE(store.samples().is_ahead_of_memory({"a", "fast"}));
  EXPECT_FALSE(store.samples().is_ahead_of_memory({"a", "slow"}))
      << "nothing of it is on its way there";
  store.samples().append(rows(4, 5), second.take());
  EXPECT_EQ(second.calls, std::vector{false});
  EXPECT_EQ(second.given.size(), 2U);
  thaw();
  EXPECT_EQ(first.calls, std::vector{true});
  EXPECT_EQ(store.samples().at_disk(), 0U);
  EXPECT_EQ(stored(), 3U);
  EXPECT_EQ(shelf.drain(), R"(a/fast[1,2,3]})");
}

TEST_F(GuardedStoreTest, RowsThatStayOnTheirWayAreNotOnDiskTwice) {
  auto held = rows(1, 2);
  freeze();
  EXPECT_FALSE(store.samples().hold(held));
  thaw();
  EXPECT_EQ(stored(), 0U) << "the caller has them, and may write them anew";
  EXPECT_TRUE(store.samples().hold(held));
  EXPECT_EQ(stored(), 2U);
}

TEST_F(GuardedStoreTest, AcknowledgedRowsLeaveWhenTheDiskAnswers) {
  Outcome outcome;
  store.samples().append(rows(1, 4), outcome.take());
  const auto batch = store.samples().next(std::make_shared<test::JsonHistory>(32), test::any);
  ASSERT_TRUE(batch);
  ASSERT_LT(batch->row_ids.size(), 4U);
  freeze();
  EXPECT_FALSE(store.journal().journal(std::vector{entry("a")}));
  std::uint64_t removed = 0;
  store.samples().remove(*batch, [&](std::uint64_t count) { removed += count; });
  EXPECT_EQ(removed, 0U);
  EXPECT_EQ(stored(), 4U);
  EXPECT_FALSE(store.samples().next(std::make_shared<test::JsonHistory>(32), test::any));
  thaw();
  EXPECT_EQ(removed, batch->row_ids.size());
  EXPECT_EQ(stored(), 4U - removed);
}

TEST_F(GuardedStoreTest, RowsDroppedBeforeTheDiskHangsAreCountedMeanwhile) {
  test::Shelf small;
  small.config.max_bytes = 1000;
  GuardedStore guarded{small.open(), [] {}};
  guarded.set_patience(1h);
  Outcome outcome;
  guarded.samples().append(rows(1, 100), outcome.take());
  const test::Frost still(disk);
  guarded.set_patience(1ms);
  EXPECT_FALSE(guarded.journal().journal(std::vector{entry("a")}));
  ASSERT_TRUE(guarded.hangs());
  ASSERT_LT(guarded.figures().rows, 100U);
  EXPECT_EQ(guarded.samples().take_dropped().at("a"), 100 - guarded.figures().rows);
  EXPECT_TRUE(guarded.samples().take_dropped().empty());
}

TEST_F(GuardedStoreTest, StreamsOfRowsOnDiskAreAheadOfMemoryWhileItHangs) {
  Outcome before;
  Outcome meanwhile;
  store.samples().append(rows(1, 2, "b"), before.take());
  freeze();
  store.samples().append(rows(1, 2), meanwhile.take());
  EXPECT_TRUE(store.samples().is_ahead_of_memory({"b", "fast"}))
      << "which has rows cannot be asked";
  thaw();
}

TEST_F(GuardedStoreTest, HistoryThatWasReadTooLateGoesOutTheNextTime) {
  Outcome outcome;
  store.samples().append(rows(1, 4), outcome.take());
  const auto acknowledged =
      store.samples().next(std::make_shared<test::JsonHistory>(32), test::any);
  ASSERT_TRUE(acknowledged);
  std::uint64_t removed = 0;
  store.samples().remove(*acknowledged, [&](std::uint64_t count) { removed += count; });
  freeze();
  EXPECT_FALSE(store.samples().next(std::make_shared<test::JsonHistory>(32), test::any));
  ASSERT_TRUE(store.hangs());
  thaw();
  EXPECT_TRUE(store.samples().next(std::make_shared<test::JsonHistory>(32), test::any));
  EXPECT_EQ(stored(), 4U - removed);
}

TEST_F(GuardedStoreTest, CommandThatWasRefusedHasItsResultInTheJournal) {
  freeze();
  const JournalEntry first = shelf.arrived("first");
  EXPECT_FALSE(store.journal().journal(std::vector{first}));
  EXPECT_TRUE(store.hangs());
  JournalEntry late = shelf.arrived("late");
  late.audit = test::told("late");
  EXPECT_FALSE(store.journal().journal(std::vector{late}));
  JournalEntry first_result = entry("first", R"({"status":"REJECTED"})");
  first_result.number = first.number;
  JournalEntry late_result = entry("late", R"({"status":"REJECTED"})");
  late_result.number = late.number;
  store.journal().record({first_result, late_result});
  ASSERT_TRUE(store.journal().find("a", "late"));
  store.journal().acknowledge("a", "late", late.number, "7");
  thaw();
  EXPECT_EQ(inside().journal().find("a", "first")->result, R"({"status":"REJECTED"})");
  EXPECT_EQ(inside().journal().find("a", "late")->result, R"({"status":"REJECTED"})");
  store.close();
  // Every command has its result, so a restart makes no other.
  Store& again = shelf.open();
  std::vector<std::string> open;
  for (const JournalEntry& each : again.journal().unacknowledged()) open.push_back(each.id);
  EXPECT_EQ(open, std::vector<std::string>{"first"});
  EXPECT_EQ(again.journal().find("a", "first")->result, R"({"status":"REJECTED"})");
  EXPECT_EQ(test::audit_of(shelf).size(), 1U) << "it came, and the audit says so";
}

TEST_F(GuardedStoreTest, JournalIsReadAtTheStartHoweverLongThatTakes) {
  shelf.record_acknowledged(shelf.arrived("known", "{}"));
  shelf.record(shelf.arrived("published", "{}"));
  inside().upkeep(kStart, kNow);
  store.set_patience(0ms);
  EXPECT_EQ(store.journal().known_ids().size(), 2U);
  EXPECT_EQ(store.journal().unacknowledged().size(), 1U);
  EXPECT_FALSE(store.hangs());
  store.set_patience(1h);
}

TEST_F(GuardedStoreTest, AuditThatFindsNoRoomIsCounted) {
  freeze();
  EXPECT_FALSE(store.journal().journal(std::vector{entry("a")}));
  const std::string body = R"({"kind":"told"})";
  for (std::size_t i = 0; i < AuditTrail::kMostWaiting + 5; ++i) store.journal().note(body);
  thaw();
  store.close();
  const auto records = test::audit_of(shelf);
  ASSERT_EQ(records.size(), AuditTrail::kMostWaiting + 1);
  EXPECT_NE(records.back().find(R"("records":5)"), std::string::npos) << records.back();
}

TEST_F(GuardedStoreTest, NumbersThatWereUsedMeanwhileAreReserved) {
  EXPECT_EQ(shelf.begin(1000), 1000U);
  freeze();
  store.samples().used("a", 1000 + SequenceNumbers::kBlock);
  EXPECT_TRUE(store.hangs());
  store.samples().used("a", 1000 + 3 * SequenceNumbers::kBlock);
  EXPECT_EQ(store.samples().join({"new"}, 5000), std::vector<std::uint64_t>{5000});
  thaw();
  shelf.store.reset();  // like a crash
  shelf.open();
  EXPECT_GE(shelf.begin(1000), 1000 + 3 * SequenceNumbers::kBlock);
}

TEST_F(GuardedStoreTest, WithAlwaysNumbersThatWereUsedMeanwhileAreOnDiskAfterwards) {
  test::Shelf always;
  always.config.sync_always = true;
  GuardedStore guarded{always.open(), [this] { answered.release(); }};
  always.begin(1000);
  {
    const test::Frost still(disk);
    guarded.set_patience(1ms);
    EXPECT_FALSE(guarded.journal().journal(std::vector{entry("a")}));
    guarded.samples().used("a", 1005);
    guarded.set_patience(1h);
  }
  answered.acquire();
  guarded.upkeep(kStart, kNow);
  always.store.reset();  // like a crash
  always.open();
  EXPECT_EQ(always.begin(2000), 1005U);
}

TEST_F(GuardedStoreTest, EveryHangIsTakenUpAndTheNextOneToo) {
  for (std::uint64_t i = 1; i <= 3; ++i) {
    freeze();
    EXPECT_FALSE(store.journal().journal(std::vector{shelf.arrived(std::to_string(i))}));
    // While the disk hangs, upkeep changes nothing.
    store.upkeep(kStart, kNow);
    EXPECT_TRUE(store.hangs());
    thaw();
    EXPECT_TRUE(inside().journal().find("a", std::to_string(i)));
  }
}

}  // namespace
}  // namespace fxagent
