#include "agent/store/samples/sample_streams.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

const StreamKey kFast{"a", "fast"};
const StreamKey kSlow{"a", "slow"};
const StreamKey kOther{"b", "fast"};

bool any(const StreamKey&) { return true; }

SampleStreams::Row row(std::uint64_t row_id, const StreamKey& stream) {
  return {row_id, stream, 100};
}

TEST(SampleStreams, StreamWithTheOldestRowIsNext) {
  SampleStreams streams;
  EXPECT_FALSE(streams.oldest_waiting(any));
  streams.found(kOther, 3, 300, 7);
  streams.added(row(9, kFast));
  EXPECT_EQ(streams.oldest_waiting(any), kOther);
  EXPECT_EQ(streams.oldest_waiting([](const StreamKey& key) { return key != kOther; }), kFast);
  EXPECT_EQ(streams.rows(), 4U);
  EXPECT_EQ(streams.bytes(), 400U);
}

struct SampleStreamsWithARow : ::testing::Test {
  SampleStreamsWithARow() { streams.added(row(1, kFast)); }
  SampleStreams streams;
};

TEST_F(SampleStreamsWithARow, StreamWithAMessageOnItsWayIsPassedOver) {
  streams.added(row(2, kSlow));
  streams.set_on_the_way(kFast, true);
  EXPECT_TRUE(streams.is_on_the_way(kFast));
  EXPECT_EQ(streams.oldest_waiting(any), kSlow);
  streams.set_on_the_way(kFast, false);
  EXPECT_EQ(streams.oldest_waiting(any), kFast);
}

TEST_F(SampleStreamsWithARow, RowThatIsOutWaitsForNobodyUntilItIsReleased) {
  streams.take(row(1, kFast));
  EXPECT_TRUE(streams.is_out(1));
  EXPECT_FALSE(streams.has_waiting(kFast));
  EXPECT_FALSE(streams.has_waiting("a"));
  EXPECT_FALSE(streams.oldest_waiting(any));
  streams.release(1);
  streams.release(1);
  EXPECT_TRUE(streams.has_waiting(kFast));
  EXPECT_TRUE(streams.has_waiting("a"));
  EXPECT_FALSE(streams.has_waiting("b"));
}

TEST_F(SampleStreamsWithARow, StreamWhoseOldRowsAreGoneLetsAnOlderOneGoFirst) {
  streams.added(row(2, kSlow));
  streams.added(row(3, kFast));
  streams.added(row(4, kFast));
  for (const std::uint64_t id : {1U, 3U}) streams.take(row(id, kFast));
  for (const std::uint64_t id : {1U, 3U}) ASSERT_TRUE(streams.remove(id));
  EXPECT_EQ(streams.oldest_waiting(any), kSlow);
}

TEST_F(SampleStreamsWithARow, RowIsRemovedOnceAndOnlyWhileItIsOut) {
  EXPECT_FALSE(streams.remove(1));
  streams.take(row(1, kFast));
  EXPECT_TRUE(streams.remove(1));
  EXPECT_FALSE(streams.remove(1));
  EXPECT_EQ(streams.rows(), 0U);
  EXPECT_EQ(streams.bytes(), 0U);
}

TEST_F(SampleStreamsWithARow, RowThatMakesRoomIsGoneEvenWhereItWasOut) {
  streams.added(row(2, kFast));
  streams.take(row(1, kFast));
  streams.remove_oldest(row(1, kFast));
  EXPECT_FALSE(streams.remove(1));
  EXPECT_TRUE(streams.has_waiting(kFast));
  EXPECT_EQ(streams.rows(), 1U);
}

TEST_F(SampleStreamsWithARow, ClearSaysHowManyEachDeviceHad) {
  streams.added(row(2, kSlow));
  streams.added(row(3, kOther));
  streams.take(row(3, kOther));
  EXPECT_EQ(streams.clear(), (std::map<std::string, std::uint64_t>{{"a", 2}, {"b", 1}}));
  EXPECT_EQ(streams.rows(), 0U);
  EXPECT_FALSE(streams.is_out(3));
  EXPECT_TRUE(streams.clear().empty());
}

}  // namespace
}  // namespace fxagent
