#include "agent/uplink/backlog.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

Backlog::Row row(std::uint64_t order, std::uint32_t device = 0, std::uint32_t group = 0) {
  return {order, device, group, std::to_string(order)};
}

bool any(std::uint32_t) { return true; }

TEST(Backlog, OldestLaneGoesFirstAndKeepsItsOrder) {
  Backlog backlog(1 << 20);
  for (const auto& r : {row(3, 1), row(1, 0, 1), row(4, 0, 0), row(2, 0, 1)}) backlog.append(r);
  const auto first = backlog.next(1000, any);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->device, 0U);
  EXPECT_EQ(first->group, 1U);
  EXPECT_EQ(first->payload, R"({"history":true,"rows":[1,2]})");
  const auto second = backlog.next(1000, any);
  ASSERT_TRUE(second);
  EXPECT_EQ(second->device, 1U);
}

TEST(Backlog, MessageKeepsItsSizeAndALargerRowGoesAlone) {
  Backlog backlog(1 << 20);
  for (std::uint64_t order = 10; order < 20; ++order) backlog.append(row(order));
  const auto two = backlog.next(26 + 2 + 1 + 2, any);
  ASSERT_TRUE(two);
  EXPECT_EQ(two->orders.size(), 2U);
  EXPECT_EQ(two->payload.size(), 26U + 2 + 1 + 2);
  EXPECT_EQ(backlog.acknowledged(*two), 2U);
  const auto one = backlog.next(1, any);
  ASSERT_TRUE(one);
  EXPECT_EQ(one->orders.size(), 1U);
}

TEST(Backlog, LaneWaitsForItsBatchAndTakesItBack) {
  Backlog backlog(1 << 20);
  backlog.append(row(1));
  backlog.append(row(2));
  const auto first = backlog.next(27, any);
  ASSERT_TRUE(first);
  EXPECT_FALSE(backlog.next(27, any));
  backlog.returned(*first);
  const auto again = backlog.next(1000, any);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->orders, (std::vector<std::uint64_t>{1, 2}));
  EXPECT_EQ(backlog.acknowledged(*again), 2U);
  EXPECT_EQ(backlog.rows(), 0U);
  EXPECT_EQ(backlog.bytes(), 0U);
}

TEST(Backlog, FullBacklogLetsTheOldestGoAndCountsThemByDevice) {
  const std::size_t room = 3 * (Backlog::kRowOverhead + 1);
  Backlog backlog(room);
  backlog.append(row(1, 7));
  backlog.append(row(2, 8));
  for (std::uint64_t order = 3; order < 6; ++order) backlog.append(row(order, 9));
  EXPECT_EQ(backlog.rows(), 3U);
  EXPECT_LE(backlog.bytes(), room);
  const auto dropped = backlog.take_dropped();
  EXPECT_EQ(dropped, (std::map<std::uint32_t, std::uint64_t>{{7, 1}, {8, 1}}));
  EXPECT_TRUE(backlog.take_dropped().empty());
}

TEST(Backlog, RowThatMadeRoomOnItsWayIsNotAcknowledgedToo) {
  Backlog backlog(2 * (Backlog::kRowOverhead + 1));
  backlog.append(row(1));
  const auto batch = backlog.next(1000, any);
  ASSERT_TRUE(batch);
  backlog.append(row(2));
  backlog.append(row(3));  // 1 makes room
  EXPECT_EQ(backlog.take_dropped().at(0), 1U);
  EXPECT_EQ(backlog.acknowledged(*batch), 0U);
  EXPECT_EQ(backlog.rows(), 2U);
}

TEST(Backlog, PausedDeviceIsPassedOver) {
  Backlog backlog(1 << 20);
  backlog.append(row(1, 0));
  backlog.append(row(2, 1));
  const auto batch = backlog.next(1000, [](std::uint32_t device) { return device == 1; });
  ASSERT_TRUE(batch);
  EXPECT_EQ(batch->device, 1U);
  EXPECT_TRUE(backlog.has_waiting(0));
  EXPECT_FALSE(backlog.has_waiting(1));
}

}  // namespace
}  // namespace fxagent
