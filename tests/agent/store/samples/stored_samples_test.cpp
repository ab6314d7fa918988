#include "agent/store/samples/stored_samples.h"

#include <gtest/gtest.h>

#include "tests/agent/store/json_history.h"
#include "tests/agent/store/shelf.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using namespace test;

TEST(StoredSamples, RowsOutliveTheProcessAndGoOldestFirst) {
  OpenShelf shelf;
  ASSERT_EQ(shelf.store->state(), "disk");
  ASSERT_TRUE(shelf.add(rows(3, 4, "b")));
  ASSERT_TRUE(shelf.add(rows(1, 3)));
  const std::uint64_t bytes = shelf.store->bytes();
  shelf.open();
  EXPECT_EQ(shelf.store->samples().recovered(), 5U);
  EXPECT_EQ(shelf.store->bytes(), bytes);
  EXPECT_EQ(shelf.drain(), "b/fast[3,4]}a/fast[1,2,3]}");
  EXPECT_EQ(shelf.store->samples().rows(), 0U);
  EXPECT_EQ(shelf.store->bytes(), 0U);
  shelf.store->close();
  EXPECT_EQ(shelf.open().samples().recovered(), 0U);
}

TEST(StoredSamples, NumbersDecideTheSequenceOfAStream) {
  OpenShelf shelf;
  shelf.add(rows(3, 4));
  shelf.add(rows(1, 2));
  EXPECT_EQ(shelf.drain(27), "a/fast[1]}a/fast[2]}a/fast[3]}a/fast[4]}");
}

TEST(StoredSamples, UnacknowledgedRowsAreStillThereAfterACrash) {
  OpenShelf shelf;
  shelf.add(rows(1, 3));
  const auto batch = test::next(shelf.store->samples(), 65536, any);
  ASSERT_TRUE(batch);
  EXPECT_FALSE(test::next(shelf.store->samples(), 65536, any));  // one pending batch per stream
  EXPECT_EQ(shelf.store->samples().rows(), 3U);
  shelf.open();
  EXPECT_EQ(shelf.drain(), "a/fast[1,2,3]}");
}

TEST(StoredSamples, ReturnedRowsGoAgainInTheirPlaces) {
  OpenShelf shelf;
  shelf.add(rows(1, 3));
  const auto batch = test::next(shelf.store->samples(), 28, any);
  ASSERT_TRUE(batch);
  shelf.add(rows(4, 4));
  shelf.store->samples().returned(*batch);
  EXPECT_EQ(shelf.drain(), "a/fast[1,2,3,4]}");
}

TEST(StoredSamples, HeldRowsAreNoHistoryUntilTheyAreReleased) {
  OpenShelf shelf;
  auto held = rows(1, 3);
  ASSERT_TRUE(shelf.store->samples().append(held, Store::Hold::yes));
  EXPECT_FALSE(shelf.store->samples().streams().has_waiting("a"));
  EXPECT_FALSE(test::next(shelf.store->samples(), 65536, any));
  EXPECT_EQ(shelf.store->samples().remove(held[0].row_id), 1U);
  EXPECT_EQ(shelf.store->samples().remove(held[0].row_id), 0U);
  shelf.store->samples().release(held[2].row_id);
  EXPECT_TRUE(shelf.store->samples().streams().has_waiting("a"));
  EXPECT_EQ(shelf.drain(), "a/fast[3]}");
  EXPECT_EQ(shelf.store->samples().rows(), 1U);
  shelf.store->upkeep(kStart, kNow);
  shelf.open();
  EXPECT_EQ(shelf.drain(), "a/fast[2]}");
}

TEST(StoredSamples, PausedLaneIsPassedOver) {
  OpenShelf shelf;
  shelf.add(rows(1, 1));
  shelf.add(rows(1, 1, "b"));
  const auto batch = test::next(shelf.store->samples(), 65536,
                                [](const StreamKey& stream) { return stream.device == "b"; });
  ASSERT_TRUE(batch);
  EXPECT_EQ(batch->stream.device, "b");
  EXPECT_TRUE(shelf.store->samples().streams().is_on_the_way({"b", "fast"}));
}

TEST(StoredSamples, FullStoreLetsTheOldestGoAndCountsThem) {
  Shelf shelf;
  shelf.config.max_bytes = 5 * (SampleRow::kOverhead + kRowBytes);
  shelf.open();
  shelf.add(rows(1, 2, "b"));
  shelf.add(rows(1, 5));
  EXPECT_EQ(shelf.store->samples().rows(), 5U);
  EXPECT_EQ(shelf.store->samples().take_dropped(),
            (std::map<std::string, std::uint64_t>{{"b", 2}}));
  const auto batch =
      test::next(shelf.store->samples(), 27, any);  // row 1 is in flight and makes room
  shelf.add(rows(6, 6));
  EXPECT_EQ(shelf.store->samples().take_dropped().at("a"), 1U);
  EXPECT_EQ(shelf.store->samples().remove(*batch), 0U);
  EXPECT_EQ(shelf.store->samples().rows(), 5U);
  EXPECT_LE(shelf.store->bytes(), shelf.config.max_bytes);
  shelf.open();
  EXPECT_EQ(shelf.drain(), "a/fast[2,3,4,5,6]}");
}

TEST(StoredSamples, RowsThatAreTooOldGo) {
  Shelf shelf;
  shelf.config.max_age = 1h;
  shelf.open();
  shelf.add(rows(1, 2));
  shelf.store->upkeep(kStart, kNow);
  shelf.store->upkeep(kStart + 30min, kNow + 1800000);
  shelf.add(rows(3, 3));
  shelf.store->upkeep(kStart + 1h, kNow + 3600000);
  EXPECT_TRUE(shelf.store->samples().take_dropped().empty());
  shelf.store->upkeep(kStart + 90min, kNow + 5400000);
  EXPECT_EQ(shelf.store->samples().take_dropped().at("a"), 2U);
  EXPECT_EQ(shelf.drain(), "a/fast[3]}");
}

TEST(StoredSamples, RowsThatAreAcknowledgedDoNotCountAsTooOld) {
  Shelf shelf;
  shelf.config.max_age = 1h;
  shelf.open();
  shelf.store->upkeep(kStart, kNow);
  shelf.add(rows(1, 3));
  shelf.store->note_time(kStart + 2h, kNow + 7200000);
  const auto batch = test::next(shelf.store->samples(), 30, any);
  ASSERT_TRUE(batch);
  ASSERT_EQ(batch->row_ids.size(), 2U);
  ASSERT_EQ(shelf.store->samples().remove(*batch), 2U);
  shelf.store->samples().drop_old();
  EXPECT_EQ(shelf.store->samples().rows(), 0U);
  EXPECT_EQ(shelf.store->samples().take_dropped().at("a"), 1U) << "the one that waited";
}

TEST(StoredSamples, AcknowledgedRowsMakeRoomBeforeAnyIsDropped) {
  Shelf shelf;
  shelf.config.max_bytes = 5 * (SampleRow::kOverhead + kRowBytes);
  shelf.open();
  shelf.add(rows(1, 5));
  const auto batch = test::next(shelf.store->samples(), 30, any);
  ASSERT_TRUE(batch);
  ASSERT_EQ(shelf.store->samples().remove(*batch), 2U);
  shelf.add(rows(6, 9));
  EXPECT_EQ(shelf.store->samples().take_dropped().at("a"), 2U);
  EXPECT_EQ(shelf.drain(), "a/fast[5,6,7,8,9]}");
}

TEST(StoredSamples, SamplesKeepToTheRoomThatCommandsLeave) {
  Shelf shelf;
  shelf.config.max_bytes = 1 << 20;
  shelf.open();
  for (int i = 0; i < 6; ++i) {
    JournalEntry order = shelf.arrived(std::to_string(i));
    order.payload = std::string(65536, 'p');
    ASSERT_TRUE(shelf.journal(order));
  }
  std::vector<SampleRow> samples = rows(1, 4);
  for (SampleRow& row : samples) row.content = std::string(200000, 'x');
  ASSERT_TRUE(shelf.add(samples));
  EXPECT_LE(shelf.store->bytes(), shelf.store->max_bytes());
  EXPECT_EQ(shelf.store->samples().rows(), 3U);
}

TEST(StoredSamples, CommandsCountIntoTheLimitAndTheOldestSamplesMakeRoom) {
  Shelf shelf;
  shelf.config.max_bytes = 1 << 20;
  shelf.open();
  std::vector<SampleRow> samples = rows(1, 3);
  for (SampleRow& row : samples) row.content = std::string(250000, 'x');
  ASSERT_TRUE(shelf.add(samples));
  for (int i = 0; i < 6; ++i) {
    JournalEntry order = shelf.arrived(std::to_string(i));
    order.payload = std::string(65536, 'p');
    ASSERT_TRUE(shelf.journal(order));
  }
  EXPECT_GT(shelf.store->bytes(), shelf.store->max_bytes());
  shelf.store->upkeep(kStart, kNow);
  EXPECT_LE(shelf.store->bytes(), shelf.store->max_bytes());
  EXPECT_EQ(shelf.store->samples().rows(), 2U);
  EXPECT_EQ(shelf.store->samples().take_dropped().at("a"), 1U);
  const std::uint64_t bytes = shelf.store->bytes();
  EXPECT_EQ(shelf.open().bytes(), bytes) << "counted anew as they were counted on their way";
}

TEST(StoredSamples, FullDiskKeepsWhatItHasAndTakesMoreWhenThereIsRoom) {
  OpenShelf shelf;
  shelf.add(rows(1, 3));
  shelf.store->upkeep(kStart, kNow);
  SteadyTime now = kStart;
  {
    const DiskLimit full(200000);
    std::uint64_t seq = 4;
    do {  // each checkpoint makes room in the log, until the file itself is full
      while (shelf.add(rows(seq, seq + 99))) seq += 100;
      EXPECT_EQ(shelf.store->state(), "memory");
      shelf.store->upkeep(now += 1s, kNow);
      shelf.store->upkeep(now += 10s, kNow);
    } while (shelf.store->state() == "disk");
    EXPECT_GT(seq, 500U);
    EXPECT_EQ(shelf.store->samples().rows(), seq - 1);
    const auto batch = test::next(shelf.store->samples(), 4096, any);  // reads continue
    ASSERT_TRUE(batch);
    EXPECT_EQ(shelf.store->samples().remove(*batch), batch->row_ids.size());
    shelf.store->upkeep(now += 10s, kNow);
    EXPECT_EQ(shelf.store->state(), "memory");
  }
  const std::uint64_t left = shelf.store->samples().rows();
  EXPECT_GT(left, 500U);
  shelf.store->upkeep(now += 10s, kNow);
  EXPECT_EQ(shelf.store->state(), "disk");
  EXPECT_TRUE(shelf.add(rows(100000, 100000)));
  EXPECT_EQ(shelf.store->samples().rows(), left + 1);
  shelf.open();
  EXPECT_EQ(shelf.store->samples().rows(), left + 1);
}

}  // namespace
}  // namespace fxagent
