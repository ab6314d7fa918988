#include "agent/field/poll/hole_map.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/agent/field/field_plant.h"
#include "tests/support/pick.h"

namespace fxagent::test {
namespace {

using namespace std::chrono_literals;

/// A device that refuses every read that touches certain registers or is too long, and the reads
/// planned for it in each cycle. The registers are the D of a PLC.
struct Refuser {
  std::shared_ptr<const Codec> codec = port_codec();
  std::vector<Point> points;
  std::set<std::uint32_t> lacks;
  std::uint32_t longest = 1000;  // words
  HoleMap map;
  SteadyTime now{};
  int refusals = 0;
  int naks_of_good_points = 0;  // existing points that a cycle did not read

  void add(std::uint32_t number, std::uint16_t count = 1) {
    TagConfig made = tag(*codec, "t", "D" + std::to_string(number), DataType::int16);
    if (count > 1) made = array_of(made, count);
    points.push_back(made.point);
  }
  Plan plan() const { return make_plan(*codec, points, LineCost{1ms, 30ms}, 0, map.holes()); }
  bool exists(std::size_t point) const {
    const Span span = *span_of(points[point]);
    for (std::uint32_t bit = span.first_bit; bit < span.end_bit(); bit += 16)
      if (lacks.contains(bit / 16)) return false;
    return true;
  }
  bool answers(const Span& read) const {
    if (read.bits / 16 > longest) return false;
    const auto first = lacks.lower_bound(read.first_bit / 16);
    return first == lacks.end() || *first * 16 >= read.end_bit();
  }

  /// Runs one cycle. Returns true if no read was refused.
  bool cycle() {
    now += 1s;
    map.retry(now);
    const Plan planned = plan();
    std::set<std::uint32_t> good;
    bool all = true;
    for (std::uint32_t i = 0; i < points.size(); ++i)
      if (planned.sources[i].count > 0) good.insert(i);
    for (const PlannedRead& read : planned.reads) {
      if (answers(read.read.span)) {
        map.read(read.read.span);
        continue;
      }
      all = false;
      ++refusals;
      for (const std::uint32_t point : read.points) good.erase(point);
      map.refused(read.read.span, halves_of(*codec, points, read), now);
    }
    naks_of_good_points = 0;
    for (std::uint32_t i = 0; i < points.size(); ++i)
      if (exists(i) && !good.contains(i)) ++naks_of_good_points;
    return all;
  }
  /// Returns the cycles until no read is refused any more; -1: never.
  int settle(int at_most = 200) {
    for (int cycles = 0; cycles < at_most; ++cycles)
      if (cycle()) return cycles;
    return -1;
  }
};

TEST(HoleMap, AMissingRegisterIsFoundByHalvingAndItsNeighboursAreReadAgain) {
  Refuser device;
  for (std::uint32_t n = 0; n < 16; ++n) device.add(n);
  device.lacks = {5};
  const int cycles = device.settle();
  EXPECT_GE(cycles, 4);
  EXPECT_LE(cycles, 6);
  EXPECT_EQ(device.map.holes().missing,
            (std::vector<Span>{{device.points[0].address.span.space, 80, 16}}));
  EXPECT_TRUE(device.map.holes().cuts.empty()) << "what was cut on the way is joined again";
  EXPECT_EQ(device.plan().reads.size(), 2U);
  EXPECT_EQ(device.naks_of_good_points, 0);
}

TEST(HoleMap, AGapThatMayNotBeReadIsLeftOut) {
  Refuser device;
  for (std::uint32_t n = 0; n < 8; ++n) device.add(n);
  for (std::uint32_t n = 12; n < 20; ++n) device.add(n);
  device.lacks = {9, 10};
  ASSERT_GE(device.settle(), 0);
  EXPECT_TRUE(device.map.holes().missing.empty());
  ASSERT_EQ(device.map.holes().cuts.size(), 1U);
  EXPECT_EQ(device.map.holes().cuts[0].at, 12 * 16U);
  EXPECT_EQ(device.plan().reads.size(), 2U);
}

TEST(HoleMap, ADeviceThatGivesShortBlocksOnlyIsAskedForShortBlocksEverywhere) {
  Refuser device;
  for (std::uint32_t n = 0; n < 400; ++n) device.add(n);
  device.longest = 20;
  ASSERT_GE(device.settle(), 0);
  EXPECT_TRUE(device.map.holes().missing.empty());
  EXPECT_TRUE(device.map.holes().cuts.empty());
  ASSERT_EQ(device.map.holes().limits.size(), 1U);
  EXPECT_LE(device.map.holes().limits[0].bits, 20 * 16U);
  EXPECT_GE(device.map.holes().limits[0].bits, 10 * 16U);
  EXPECT_LT(device.refusals, 60) << "one block teaches all";
}

TEST(HoleMap, RefusalThatPassesShortensReadsForAWhile) {
  Refuser device;
  for (std::uint32_t n = 0; n < 10; ++n) device.add(n);
  for (std::uint32_t n = 14; n < 24; ++n) device.add(n);
  device.lacks = {12};
  ASSERT_GE(device.settle(), 0);
  ASSERT_EQ(device.map.holes().cuts.size(), 1U);
  device.lacks = {};
  for (int second = 0; second < 605; ++second) device.cycle();
  EXPECT_TRUE(device.map.holes().cuts.empty());
  device.longest = 8;
  ASSERT_GE(device.settle(), 0);
  ASSERT_EQ(device.map.holes().limits.size(), 1U);
  device.longest = 1000;
  for (int second = 0; second < 1205; ++second) device.cycle();
  EXPECT_TRUE(device.map.holes().limits.empty());
  EXPECT_EQ(device.plan().reads.size(), 1U);
}

TEST(HoleMap, DeviceOfShortBlocksIsTriedWithLongOnesLessAndLessOften) {
  Refuser device;
  for (std::uint32_t n = 0; n < 30; ++n) device.add(n);
  device.longest = 20;
  ASSERT_GE(device.settle(), 0);
  const int before = device.refusals;
  for (int second = 0; second < 3600; ++second) device.cycle();
  EXPECT_EQ(device.refusals - before, 2) << "after 10 and 30 minutes";
}

TEST(HoleMap, RefusalOfAShortReadTearsNoValueApart) {
  Refuser device;
  device.add(0);
  device.add(1);
  for (const DataType type : {DataType::uint32, DataType::float64})
    device.points.push_back(
        tag(*device.codec, "t", type == DataType::uint32 ? "D300" : "D600", type).point);
  const std::uint16_t space = device.points[0].address.span.space;
  device.map.refused({space, 0, 32}, Halves{16, 16}, device.now);
  device.map.read({space, 0, 16});
  device.map.read({space, 16, 16});
  const Plan plan = device.plan();
  for (const PointSource& source : plan.sources) EXPECT_EQ(source.count, 1U);
  EXPECT_EQ(plan.reads.size(), 4U) << "the two that were refused together stay apart";
}

TEST(HoleMap, ALimitThatWasLearnedDoesNotGrowByAnotherBlock) {
  const auto words = [](std::uint32_t first, std::uint32_t count) {
    return Span{0, 16 * first, 16 * count};
  };
  HoleMap map;
  // Reads of two cycles, both planned before any hole was known.
  for (const auto& [first, count] : {std::pair{0U, 30U}, {1000U, 100U}}) {
    const std::uint32_t middle = first + count / 2;
    map.refused(words(first, count), Halves{16 * middle, 16 * middle}, SteadyTime{});
    map.read(words(first, count / 2));
    map.read(words(middle, count / 2));
    ASSERT_EQ(map.holes().limits.size(), 1U);
    EXPECT_EQ(map.holes().limits[0].bits, 15U * 16);
  }
}

TEST(HoleMap, LimitForCommandsStaysUntilALongerReadSucceeds) {
  const Span whole{0, 0, 16 * 40};
  HoleMap map;
  map.refused(whole, Halves{16 * 20, 16 * 20}, SteadyTime{});
  map.read({0, 0, 16 * 20});
  map.read({0, 16 * 20, 16 * 20});
  map.retry(SteadyTime{});
  map.retry(SteadyTime{} + 600s);
  EXPECT_TRUE(map.holes().limits.empty());
  map.read({0, 0, 16 * 20});
  map.read({1, 0, 16 * 40});  // another space
  EXPECT_EQ(map.command_limits(), (std::vector<Holes::Limit>{{0, 16 * 20}}));
  map.read(whole);
  EXPECT_TRUE(map.command_limits().empty());
}

TEST(HoleMap, AnArrayLongerThanTheDeviceGivesIsReadInPieces) {
  Refuser device;
  device.add(0, 30);
  device.longest = 8;
  ASSERT_GE(device.settle(), 0);
  EXPECT_EQ(device.naks_of_good_points, 0);
  EXPECT_GE(device.plan().sources[0].count, 4U);
}

TEST(HoleMap, WhatStaysMissingIsAskedForEachTenMinutesHoweverLongItLasts) {
  Refuser device;
  device.add(5);
  const Span missing = device.points[0].address.span;
  device.map.refused(missing, std::nullopt, device.now);
  std::vector<std::int64_t> pauses;
  SteadyTime asked = device.now;
  for (int second = 0; second < 24 * 3600; ++second) {
    device.now += 1s;
    device.map.retry(device.now);
    if (!device.map.holes().missing.empty()) continue;
    pauses.push_back((device.now - asked) / 1s);
    asked = device.now;
    device.map.refused(missing, std::nullopt, device.now);
  }
  ASSERT_GE(pauses.size(), 8U);
  EXPECT_EQ(std::vector(pauses.begin(), pauses.begin() + 8),
            (std::vector<std::int64_t>{10, 20, 40, 80, 160, 320, 600, 600}));
  EXPECT_EQ(*std::max_element(pauses.begin(), pauses.end()), 600);
}

TEST(HoleMap, WhatIsMissingIsAskedForAgainWithoutHarmToItsNeighbours) {
  Refuser device;
  for (std::uint32_t n = 0; n < 16; ++n) device.add(n);
  device.lacks = {5, 6};
  ASSERT_GE(device.settle(), 0);
  const int before = device.refusals;
  for (int second = 0; second < 120; ++second) {
    device.cycle();
    EXPECT_EQ(device.naks_of_good_points, 0) << "after " << second << " s";
  }
  // 10, 20 and 40 s apart, two registers each time.
  EXPECT_EQ(device.refusals - before, 6);
  device.lacks.clear();
  for (int second = 0; second < 200; ++second) device.cycle();
  EXPECT_TRUE(device.map.holes().missing.empty());
  EXPECT_TRUE(device.map.holes().cuts.empty());
  EXPECT_EQ(device.plan().reads.size(), 1U);
}

TEST(HoleMap, AnyDeviceIsKnownInTheEnd) {
  Pick pick(77);
  for (int round = 0; round < 200; ++round) {
    Refuser device;
    for (std::uint32_t n = pick(1, 40); n > 0; --n)
      device.add(pick(0, 120), static_cast<std::uint16_t>(pick(1, 4)));
    for (std::uint32_t n = pick(0, 12); n > 0; --n) device.lacks.insert(pick(0, 130));
    if (round % 3 == 0) device.longest = pick(1, 40);
    ASSERT_GE(device.settle(), 0) << "round " << round;
    EXPECT_EQ(device.naks_of_good_points, 0) << "round " << round;
    const Plan plan = device.plan();
    for (std::uint32_t i = 0; i < device.points.size(); ++i)
      EXPECT_EQ(plan.sources[i].count > 0, device.exists(i)) << "round " << round;
  }
}

TEST(HoleMap, NothingRefusedIsNothingLearnt) {
  Refuser device;
  for (std::uint32_t n = 0; n < 100; ++n) device.add(n);
  EXPECT_EQ(device.settle(), 0);
  EXPECT_EQ(device.map.version(), 0U);
}

}  // namespace
}  // namespace fxagent::test
