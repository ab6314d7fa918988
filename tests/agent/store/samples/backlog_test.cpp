#include "agent/store/samples/backlog.h"

#include <gtest/gtest.h>

#include "tests/agent/store/json_history.h"

namespace fxagent {
namespace {

SampleRow row(std::uint64_t number, std::string device = "a", std::string group = "fast") {
  return {number, {std::move(device), std::move(group)}, number, test::row_content(number)};
}

bool any(const StreamKey&) { return true; }

TEST(Backlog, OldestStreamGoesFirstAndKeepsItsSequence) {
  Backlog backlog(1 << 20);
  for (const auto& r : {row(3, "b"), row(1, "a", "slow"), row(4), row(2, "a", "slow")})
    backlog.append(r);
  const auto first = test::next(backlog, 1000, any).value();
  EXPECT_EQ(first.stream.device, "a");
  EXPECT_EQ(first.stream.group, "slow");
  EXPECT_EQ(first.payload, R"({"history":true,"rows":[1,2]})");
  EXPECT_EQ(test::next(backlog, 1000, any).value().stream.device, "b");
}

TEST(Backlog, MessageKeepsItsSizeAndALargerRowGoesAlone) {
  Backlog backlog(1 << 20);
  for (std::uint64_t number = 10; number < 20; ++number) backlog.append(row(number));
  const auto two = test::next(backlog, 26 + 2 + 1 + 2, any).value();
  EXPECT_EQ(two.row_ids.size(), 2U);
  EXPECT_EQ(two.payload.size(), 26U + 2 + 1 + 2);
  EXPECT_EQ(backlog.remove(two), 2U);
  EXPECT_EQ(test::next(backlog, 1, any).value().row_ids.size(), 1U);
}

TEST(Backlog, LaneWaitsForItsBatchAndTakesItBack) {
  Backlog backlog(1 << 20);
  backlog.append(row(1));
  backlog.append(row(2));
  const auto first = test::next(backlog, 27, any).value();
  EXPECT_FALSE(test::next(backlog, 27, any));
  backlog.returned(first);
  const auto again = test::next(backlog, 1000, any).value();
  EXPECT_EQ(again.row_ids, (std::vector<std::uint64_t>{1, 2}));
  EXPECT_EQ(backlog.remove(again), 2U);
  EXPECT_EQ(backlog.rows(), 0U);
  EXPECT_EQ(backlog.bytes(), 0U);
}

TEST(Backlog, FullBacklogLetsTheOldestGoAndCountsThemByDevice) {
  const std::size_t room = 3 * (SampleRow::kOverhead + test::kRowBytes);
  Backlog backlog(room);
  backlog.append(row(1, "c"));
  backlog.append(row(2, "d"));
  for (std::uint64_t number = 3; number < 6; ++number) backlog.append(row(number, "e"));
  EXPECT_EQ(backlog.rows(), 3U);
  EXPECT_LE(backlog.bytes(), room);
  const auto dropped = backlog.take_dropped();
  EXPECT_EQ(dropped, (std::map<std::string, std::uint64_t>{{"c", 1}, {"d", 1}}));
  EXPECT_TRUE(backlog.take_dropped().empty());
}

TEST(Backlog, RowThatMadeRoomOnItsWayIsNotAcknowledgedToo) {
  Backlog backlog(2 * (SampleRow::kOverhead + test::kRowBytes));
  backlog.append(row(1));
  const auto batch = test::next(backlog, 1000, any).value();
  backlog.append(row(2));
  backlog.append(row(3));  // drops 1 to make room
  EXPECT_EQ(backlog.take_dropped().at("a"), 1U);
  EXPECT_EQ(backlog.remove(batch), 0U);
  EXPECT_EQ(backlog.rows(), 2U);
}

TEST(Backlog, PausedDeviceIsPassedOver) {
  Backlog backlog(1 << 20);
  backlog.append(row(1));
  backlog.append(row(2, "b"));
  const auto batch =
      test::next(backlog, 1000, [](const StreamKey& stream) { return stream.device == "b"; });
  ASSERT_TRUE(batch);
  EXPECT_EQ(batch->stream.device, "b");
  EXPECT_TRUE(backlog.has_waiting("a"));
  EXPECT_FALSE(backlog.has_waiting("b"));
}

TEST(Backlog, WhatWaitsCanMoveAndWhatIsOnTheWayStays) {
  Backlog backlog(1 << 20);
  for (std::uint64_t number = 1; number < 5; ++number) backlog.append(row(number));
  const auto batch = test::next(backlog, 26 + 1, any).value();
  EXPECT_TRUE(backlog.is_on_the_way({"a", "fast"}));
  const auto moved = backlog.take_waiting();
  ASSERT_EQ(moved.size(), 3U);
  EXPECT_EQ(moved.front().row_id, 2U);
  EXPECT_EQ(backlog.rows(), 1U);
  backlog.returned(batch);
  EXPECT_EQ(backlog.take_waiting().size(), 1U);
  EXPECT_EQ(backlog.bytes(), 0U);
}

TEST(Backlog, StreamOfDamagedRowsAloneHoldsNoOtherUp) {
  Backlog backlog(1 << 20);
  for (std::uint64_t id = 1; id < 4; ++id) {
    SampleRow damaged = row(id, id == 3 ? "c" : "a");
    damaged.content = "{";
    backlog.append(std::move(damaged));
  }
  backlog.append(row(4, "b"));
  EXPECT_EQ(test::next(backlog, 1000, any).value().payload, R"({"history":true,"rows":[4]})");
  EXPECT_EQ(backlog.take_dropped(), (std::map<std::string, std::uint64_t>{{"a", 2}, {"c", 1}}));
  EXPECT_EQ(backlog.rows(), 1U);
  EXPECT_FALSE(test::next(backlog, 1000, any));
}

TEST(Backlog, NextLooksAtNoMoreLanesThanItMust) {
  // After an outage with thousands of devices, every message would cost a walk over all streams.
  Backlog backlog(1 << 20);
  for (std::uint64_t number = 0; number < 2000; ++number)
    backlog.append(row(number, "d" + std::to_string(number % 1000)));
  std::size_t looks = 0;
  const auto counting = [&](const StreamKey&) { return ++looks > 0; };
  for (std::uint64_t stream = 0; stream < 1000; ++stream) {
    const auto batch = test::next(backlog, 1000, counting).value();
    EXPECT_EQ(batch.stream.device, "d" + std::to_string(stream)) << "the oldest first";
    if (stream % 2 == 0)
      backlog.remove(batch);
    else
      backlog.returned(batch);
    if (stream % 2 != 0) {
      const auto again = test::next(backlog, 1000, counting).value();
      EXPECT_EQ(again.row_ids, batch.row_ids);
      backlog.remove(again);
    }
  }
  EXPECT_EQ(looks, 1500U);
  EXPECT_FALSE(test::next(backlog, 1000, counting));
  EXPECT_EQ(backlog.rows(), 0U);
}

}  // namespace
}  // namespace fxagent
