// Learning from a device that refuses reads of several places in one frame.

#include <gtest/gtest.h>

#include <algorithm>

#include "agent/field/poll/hole_map.h"
#include "tests/protocol/gathering_codec.h"
#include "tests/support/pick.h"

namespace fxagent::test {
namespace {

using namespace std::chrono_literals;

/// Words of one space, some missing, some refused only within a Gather, and frames with a lower
/// limit than documented. Handles the answers as the poller does.
struct Refuser {
  GatheringCodec codec = gathering_codec();
  std::vector<Point> points;
  std::set<std::uint32_t> lacks;
  std::set<std::uint32_t> not_gathered;
  std::size_t most_parts = 1000;
  HoleMap map;
  SteadyTime now{};

  Refuser() { codec.commands = {{1, 24}}; }
  void add(std::uint32_t number) { add("W" + std::to_string(number)); }
  void add(const std::string& address) {
    Point point{.address = *codec.parse_address(address, std::nullopt)};
    point.type = default_type(point.address);
    points.push_back(point);
  }
  bool exists(std::size_t point) const {
    return !lacks.contains(points[point].address.span.first_bit / 16);
  }
  bool answers(const Request& request) const {
    const auto has = [&](const Read& read, const std::set<std::uint32_t>& words) {
      const auto first = words.lower_bound(read.span.first_bit / 16);
      return first != words.end() && *first * 16 < read.span.end_bit();
    };
    const auto* gather = std::get_if<Gather>(&request);
    if (gather == nullptr) return !has(std::get<Read>(request), lacks);
    return gather->parts.size() <= most_parts &&
           std::none_of(gather->parts.begin(), gather->parts.end(), [&](const Read& part) {
             return has(part, lacks) || has(part, not_gathered);
           });
  }
  Plan plan() const { return make_plan(codec, points, LineCost{1ms, 30ms}, 0, map.holes()); }

  /// Runs one cycle. Returns the number of existing points that were not read.
  int cycle() {
    now += 1s;
    map.retry(now);
    const Plan planned = plan();
    std::vector<bool> good(points.size());
    for (std::uint32_t e = 0; e < planned.exchange_count(); ++e) {
      const ReadIndices which = planned.exchanges[e];
      const Request request = planned.request(which);
      const bool answered = answers(request);
      for (std::size_t i = 0; answered && i < which.size(); ++i) {
        const PlannedRead& read = planned.reads[which[i]];
        map.read(read.read.span, which.size());
        for (const std::uint32_t point : read.points) good[point] = true;
      }
      if (answered) continue;
      if (const auto* gather = std::get_if<Gather>(&request)) {
        map.refused_together(*gather, asked_in(planned, which, points));
        continue;
      }
      const PlannedRead& read = planned.reads[which[0]];
      map.refused(read.read.span, halves_of(codec, points, read), now,
                  asked_in(planned, which, points));
    }
    int missed = 0;
    for (std::uint32_t i = 0; i < points.size(); ++i) missed += exists(i) && !good[i] ? 1 : 0;
    return missed;
  }
  /// Returns the cycles until all existing points are read four times in a row; -1: never.
  int settle() {
    int quiet = 0;
    for (int cycles = 0; cycles < 200; ++cycles) {
      quiet = cycle() == 0 ? quiet + 1 : 0;
      if (quiet == 4) return cycles - 3;
    }
    return -1;
  }
};

TEST(HoleMapGather, HalvesGoOnUntilThePlaceIsKnown) {
  Refuser device;
  for (std::uint32_t n = 0; n < 24; ++n) device.add(160 * n);
  device.lacks = {960};
  EXPECT_LE(device.settle(), 7);
  EXPECT_EQ(device.map.holes().missing, (std::vector<Span>{{0, 15360, 16}}));
  EXPECT_TRUE(device.map.holes().gather_limits.empty()) << "it was the place, not the number";
  EXPECT_TRUE(device.map.holes().suspects.empty());
  EXPECT_EQ(device.plan().exchange_count(), 1U);
}

TEST(HoleMapGather, TooManyPlacesAreNoHole) {
  Refuser device;
  for (std::uint32_t n = 0; n < 24; ++n) device.add(160 * n);
  device.most_parts = 7;
  ASSERT_GE(device.settle(), 0);
  EXPECT_TRUE(device.map.holes().missing.empty());
  EXPECT_EQ(device.map.holes().gather_limits, (std::vector<Holes::GatherLimit>{{1, 6}}));
  EXPECT_EQ(device.plan().exchange_count(), 4U);
}

TEST(HoleMapGather, APlaceThatIsOnlyRefusedInCompanyStaysApart) {
  Refuser device;
  for (std::uint32_t n = 0; n < 24; ++n) device.add(160 * n);
  device.not_gathered = {960};
  ASSERT_GE(device.settle(), 0);
  EXPECT_EQ(device.map.holes().never_gathered, (std::vector<Span>{{0, 15360, 16}}));
  EXPECT_EQ(device.plan().exchange_count(), 2U);
}

TEST(HoleMapGather, AGroupThatIsReadInAnHourDoesNotHoldTheOthersDown) {
  Refuser hourly;
  for (std::uint32_t n = 0; n < 8; ++n) hourly.add(160 * n);
  hourly.lacks = {480};
  EXPECT_GT(hourly.cycle(), 0);
  const Holes& holes = hourly.map.holes();
  ASSERT_FALSE(holes.suspects.empty());
  ASSERT_LE(holes.most_others, 4U);
  // Another group of the same device, polled every second in the meantime.
  Refuser other;
  for (std::uint32_t n = 0; n < 24; ++n) other.add(2000 + 16 * n);
  const LineCost slow{1ms, 100ms};
  const auto exchanges = [&](const Holes& known) {
    return make_plan(other.codec, other.points, slow, 0, known).exchange_count();
  };
  EXPECT_EQ(exchanges(holes), exchanges({}));
  // A refusal of its own frame adds suspects of its own.
  const Plan plan = make_plan(other.codec, other.points, slow, 0, holes);
  ASSERT_EQ(plan.exchange_count(), 1U);
  const ReadIndices which = plan.exchanges[0];
  hourly.map.refused_together(std::get<Gather>(plan.request(which)),
                              asked_in(plan, which, other.points));
  EXPECT_GT(exchanges(holes), 1U);
  EXPECT_GE(hourly.settle(), 0);
}

TEST(HoleMapGather, WhatIsReadByAnotherWayIsAboveSuspicion) {
  Refuser device;
  ReadWay bits = word_way(0, 4);
  bits.align_bits = bits.unit_bits = 1;
  ReadWay sixteen_bits = word_way(1, 1, 1);
  sixteen_bits.align_bits = 1;
  device.codec.ways[1] = {bits, sixteen_bits};
  device.add("B3");
  device.add("B9000");
  device.lacks = {9000 / 16};
  ASSERT_EQ(device.plan().exchange_count(), 1U);
  ASSERT_GE(device.settle(), 0);
  EXPECT_EQ(device.map.holes().missing, (std::vector<Span>{{1, 9000, 1}}));
  EXPECT_TRUE(device.map.holes().suspects.empty());
}

TEST(HoleMapGather, NobodyWaitsForWhatLiesBetweenTwoPoints) {
  HoleMap map;
  const Span read{0, 0, 64 * 16};
  const Span left{0, 0, 16};
  const Span right{0, 63 * 16, 16};
  map.refused_together(Gather{{{read, 2, 2}, {{0, 3200, 16}, 2, 2}}}, {left, right, {0, 3200, 16}});
  for (const Span& span : {left, right, Span{0, 3200, 16}}) {
    EXPECT_FALSE(map.holes().suspects.empty());
    map.read(span);
  }
  EXPECT_TRUE(map.holes().suspects.empty());
}

TEST(HoleMapGather, WhatIsReadPieceByPieceIsAboveSuspicion) {
  HoleMap map;
  const Span array{0, 0, 64 * 16};
  map.refused_together(Gather{{{array, 2, 2}, {{0, 3200, 16}, 2, 2}}}, {array, {0, 3200, 16}});
  map.read({0, 3200, 16});
  map.read({0, 16 * 16, 16 * 16});
  map.read({0, 32 * 16, 32 * 16});
  EXPECT_EQ(map.holes().suspects, (std::vector<Span>{{0, 0, 16 * 16}}));
  map.read({0, 0, 16 * 16});
  EXPECT_TRUE(map.holes().suspects.empty());
}

TEST(HoleMapGather, AHoleInABlockDoesNotSpoilWhatGoesTogether) {
  Refuser device;
  for (std::uint32_t n = 0; n < 60; ++n) device.add(n);
  for (std::uint32_t n = 5; n < 12; ++n) device.add(160 * n);
  device.lacks = {11};
  ASSERT_GE(device.settle(), 0);
  EXPECT_EQ(device.map.holes().missing, (std::vector<Span>{{0, 11 * 16, 16}}));
}

TEST(HoleMapGather, WhatIsThereAgainIsReadAgainAndNeverTakesOthersWithIt) {
  Refuser device;
  for (std::uint32_t n = 0; n < 24; ++n) device.add(160 * n);
  device.lacks = {960};
  ASSERT_GE(device.settle(), 0);
  for (int cycle = 0; cycle < 60; ++cycle) EXPECT_EQ(device.cycle(), 0) << cycle;
  device.lacks.clear();
  int cycles = 0;
  while (device.cycle() > 0) ASSERT_LT(++cycles, 700);
}

TEST(HoleMapGather, ACommandThatTheDeviceLacksIsNotUsed) {
  Refuser device;
  for (std::uint32_t n = 0; n < 5; ++n) device.add(160 * n);
  const std::uint32_t before = device.map.version();
  EXPECT_TRUE(device.map.lacks(1, device.now));
  EXPECT_GT(device.map.version(), before);
  const auto is_used = [&device] {
    return std::ranges::any_of(device.plan().reads,
                               [](const PlannedRead& each) { return each.read.gather != 0; });
  };
  EXPECT_FALSE(is_used());
  EXPECT_EQ(device.plan().exchange_count(), 5U);
  device.map.retry(device.now + 599s);
  EXPECT_FALSE(is_used());
  EXPECT_EQ(device.plan().exchange_count(), 5U);
  device.map.retry(device.now + 600s);
  EXPECT_EQ(device.plan().exchange_count(), 1U) << "it may have been a password";
  EXPECT_FALSE(device.map.lacks(1, device.now)) << "which is told once";
}

TEST(HoleMapGather, RetriesDoNotPileUp) {
  HoleMap map;
  const Span span{0, 160, 16};
  SteadyTime now{};
  map.refused(span, std::nullopt, now, {span});
  for (int times = 0; times < 50; ++times) {
    map.retry(now += 600s);
    EXPECT_EQ(map.holes().never_gathered, std::vector<Span>{span});
    map.refused(span, std::nullopt, now, {span});
  }
  map.retry(now += 600s);
  map.read(span);
  EXPECT_TRUE(map.holes().never_gathered.empty());
  EXPECT_TRUE(map.holes().cuts.empty());
}

TEST(HoleMapGather, WhatOnlyGoesByItselfOrWithFewIsTriedAgain) {
  HoleMap map;
  SteadyTime now{};
  for (const auto after : {600s, 1200s}) {
    map.refused_together(Gather{{{{0, 160, 16}, 1, 1}}}, {{0, 160, 16}});
    const std::vector<Span> two{{0, 1600, 16}, {0, 3200, 16}};
    map.refused_together(Gather{{{two[0], 1, 1}, {two[1], 1, 1}}}, two);
    for (const Span& span : two) map.read(span);
    EXPECT_EQ(map.holes().gather_limits, (std::vector<Holes::GatherLimit>{{1, 1}}));
    map.retry(now);
    map.retry(now += after - 1s);
    EXPECT_EQ(map.holes().never_gathered.size(), 1U);
    const std::uint32_t before = map.version();
    map.retry(now += 1s);
    EXPECT_TRUE(map.holes().never_gathered.empty());
    EXPECT_TRUE(map.holes().gather_limits.empty());
    EXPECT_GT(map.version(), before);
  }
}

TEST(HoleMapGather, EachCommandHasALimitOfItsOwn) {
  HoleMap map;
  std::vector<Span> spans;
  for (std::uint32_t n = 0; n < 6; ++n) spans.push_back({0, 1600 * n, 16});
  Gather first;
  for (std::uint32_t n = 0; n < 4; ++n) first.parts.push_back({spans[n], 1, 1});
  map.refused_together(first, spans);
  map.refused_together(Gather{{{spans[4], 2, 2}, {spans[5], 2, 2}}}, spans);
  for (const Span& span : spans) map.read(span);
  EXPECT_EQ(map.holes().gather_limits, (std::vector<Holes::GatherLimit>{{1, 2}, {2, 1}}));
}

TEST(HoleMapGather, NobodyLooksIntoHundredsOfSuspects) {
  HoleMap map;
  for (std::uint32_t frame = 0; frame < 80; ++frame) {
    Gather gather;
    std::vector<Span> asked;
    for (std::uint32_t n = 0; n < 64; ++n) {
      asked.push_back({0, (frame * 64 + n) * 32, 16});
      gather.parts.push_back({asked.back(), 1, 1});
    }
    map.refused_together(gather, asked);
    EXPECT_LE(map.holes().suspects.size(), 256U);
  }
  EXPECT_EQ(map.holes().gather_limits, (std::vector<Holes::GatherLimit>{{1, 32}}));
}

TEST(HoleMapGather, WhateverIsMissingTheRestIsReadInTheEnd) {
  Pick pick(20261123);
  for (int round = 0; round < 150; ++round) {
    Refuser device;
    for (std::uint32_t n = pick(1, 40); n > 0; --n) device.add(pick(0, 3) * 700 + pick(0, 60));
    for (std::uint32_t n = pick(0, 3); n > 0; --n)
      device.lacks.insert(
          device.points[pick(0, 1000) % device.points.size()].address.span.first_bit / 16);
    for (std::uint32_t n = pick(0, 2); n > 0; --n)
      device.not_gathered.insert(
          device.points[pick(0, 1000) % device.points.size()].address.span.first_bit / 16);
    if (pick(0, 2) == 0) device.most_parts = pick(1, 12);
    EXPECT_GE(device.settle(), 0) << round;
  }
}

}  // namespace
}  // namespace fxagent::test
