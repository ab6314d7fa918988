#include "protocol/plan/gathering.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <ctime>
#include <random>

#include "protocol/plan/plan.h"
#include "tests/protocol/checked_plan.h"
#include "tests/protocol/every_plan.h"
#include "tests/protocol/gathering_codec.h"
#include "tests/support/pick.h"

namespace fxagent::test {
namespace {

using namespace std::chrono_literals;

const LineCost kCost{1ms, 30ms};
const LineCost kNoSpeed{0ns, 2ms};

Point point(const Codec& codec, const std::string& address, std::uint16_t count = 1) {
  Point out{.address = *codec.addresses().parse_address(address, std::nullopt)};
  out.type = default_type(out.address);
  out.count = count;
  out.is_array = count > 1;
  return out;
}

std::vector<Point> points_at(const Codec& codec, const std::vector<std::string>& addresses) {
  std::vector<Point> out;
  for (const std::string& address : addresses) out.push_back(point(codec, address));
  return out;
}

// ---- examples -----------------------------------------------------------------------------------

TEST(Gathering, ScatteredWordsAndBitsAreOneExchange) {
  const GatheringCodec codec = gathering_codec();
  const auto points = points_at(codec, {"W1", "W900", "W3000", "B5", "B2000"});
  for (const LineCost& cost : {kCost, kNoSpeed, LineCost{}}) {
    const Plan plan = checked_plan(codec, points, cost);
    EXPECT_EQ(plan.reads.size(), 5U);
    ASSERT_EQ(plan.exchange_count(), 1U);
    EXPECT_EQ(std::get<Gather>(plan.request(plan.exchanges[0])).parts.size(), 5U);
  }
}

TEST(Gathering, WhatLiesTogetherIsReadAsABlockBesideIt) {
  const GatheringCodec codec = gathering_codec();
  std::vector<Point> points = points_at(codec, {"W1000", "W2000", "W3000", "B5"});
  points.push_back(point(codec, "W10", 60));
  const Plan plan = checked_plan(codec, points, kCost);
  ASSERT_EQ(plan.exchange_count(), 1U) << "blocks take it all";
  EXPECT_EQ(plan.reads.front().read.gather, 2);

  GatheringCodec without_blocks = codec;
  without_blocks.commands.pop_back();
  const Plan two = checked_plan(without_blocks, points, kCost);
  ASSERT_EQ(two.exchange_count(), 2U);
  EXPECT_EQ(two.exchanges[0].size(), 1U) << "in the order of what they read";
  EXPECT_EQ(two.exchanges[1].size(), 4U);
}

TEST(Gathering, OneReadIsNotSentAsAGather) {
  const GatheringCodec codec = gathering_codec();
  for (const LineCost& cost : {kCost, kNoSpeed, LineCost{}}) {
    const auto points = points_at(codec, {"W7", "W8"});
    const Plan plan = make_plan(codec, points, cost, 0);
    ASSERT_EQ(plan.reads.size(), 1U);
    EXPECT_EQ(plan.exchange_count(), 1U);
    EXPECT_EQ(plan.reads[0].read.gather, 0);
  }
}

TEST(Gathering, WhatHasNoOtherWayGoesInAGatherOfOnePart) {
  GatheringCodec codec = gathering_codec();
  codec.ways[1] = {word_way(1, 2, 1)};
  const auto points = points_at(codec, {"V7"});
  const Plan plan = checked_plan(codec, points, kCost);
  ASSERT_EQ(plan.exchange_count(), 1U);
  EXPECT_EQ(std::get<Gather>(plan.request(std::vector{0U})).parts.size(), 1U);
  Holes lacks;
  lacks.gather_limits.push_back({1, 0});
  EXPECT_EQ(make_plan(codec, points, kCost, 0, lacks).refused, std::vector<std::uint32_t>{0});
}

TEST(Gathering, ADeviceThatLacksTheCommandIsReadOneByOne) {
  const GatheringCodec codec = gathering_codec();
  const auto points = points_at(codec, {"W1", "W900", "W3000"});
  Holes holes;
  holes.gather_limits = {{1, 0}};
  EXPECT_EQ(make_plan(codec, points, kCost, 0, holes).reads.front().read.gather, 2);
  holes.gather_limits.push_back({2, 0});
  const Plan plan = make_plan(codec, points, kCost, 0, holes);
  EXPECT_EQ(plan.reads.front().read.gather, 0);
  EXPECT_EQ(plan.exchange_count(), 3U);
  holes.gather_limits = {{1, 2}, {2, 0}};
  const Plan pairs = make_plan(codec, points, kNoSpeed, 0, holes);
  ASSERT_EQ(pairs.exchange_count(), 2U);
  EXPECT_LE(pairs.exchanges[0].size(), 2U);
}

/// Twelve words too far apart for one read, of a codec that reads 24 places in one frame.
struct GatheringOfTwelve : ::testing::Test {
  GatheringOfTwelve() {
    codec.commands = {{1, 24}};
    for (int n = 0; n < 12; ++n) points.push_back(point(codec, "W" + std::to_string(200 * n)));
  }
  GatheringCodec codec = gathering_codec();
  std::vector<Point> points;
};

TEST_F(GatheringOfTwelve, SuspectsGoWithEachOther) {
  Holes holes;
  for (std::uint32_t n = 0; n < 6; ++n) holes.suspects.push_back({0, 200 * n * 16, 16});
  holes.most_suspects = 3;
  const Plan plan = checked_plan(codec, points, kCost, 0, holes);
  ASSERT_EQ(plan.exchange_count(), 3U);
  for (std::uint32_t e = 0; e < 3; ++e) {
    const ReadIndices which = plan.exchanges[e];
    const bool suspect = which[0] < 6;
    EXPECT_EQ(which.size(), suspect ? 3U : 6U);
    for (std::size_t i = 0; i < which.size(); ++i) EXPECT_EQ(which[i] < 6, suspect);
  }
}

TEST_F(GatheringOfTwelve, OnlyPlansThatReadASuspectAreHeldDown) {
  Holes holes;
  holes.suspects = {{0, 100 * 16, 16}, {1, 200 * 16, 16}};
  holes.most_others = 3;
  EXPECT_EQ(make_plan(codec, points, kCost, 0, holes).exchange_count(), 1U);
  points.push_back(point(codec, "V200"));
  const Plan plan = checked_plan(codec, points, kCost, 0, holes);
  EXPECT_EQ(plan.exchange_count(), 4U + 1);
}

TEST_F(GatheringOfTwelve, MaxBlockBytesLowersWhatOneFrameBrings) {
  EXPECT_EQ(make_plan(codec, points, kCost, 0).exchange_count(), 1U);
  const Plan plan = make_plan(codec, points, kCost, 8);
  EXPECT_EQ(plan.exchange_count(), 3U);
}

TEST(Gathering, EachReadGetsItsOwnOutOfTheImage) {
  const GatheringCodec codec = gathering_codec();
  const auto points = points_at(codec, {"W1", "W900", "W901", "B37"});
  const Plan plan = make_plan(codec, points, kCost, 0);
  ASSERT_EQ(plan.exchange_count(), 1U);
  std::vector<Bytes> images(plan.reads.size());
  plan.share_out(plan.exchanges[0], {1, 0, 2, 0, 3, 0, 0x20, 0}, images);
  for (std::uint32_t i = 0; i < 3; ++i)
    EXPECT_EQ(value_of(plan, images, points[i], i), Value(Scalar(std::int64_t{i + 1})));
  EXPECT_EQ(value_of(plan, images, points[3], 3), Value(Scalar(true)));
  plan.share_out(plan.exchanges[0], {1, 0, 2}, images);  // shorter than requested
  EXPECT_FALSE(value_of(plan, images, points[1], 1));
}

// ---- comparison with the exhaustive search -----------------------------------------------------

/// True if a point is longer than every way. It is split, which the exhaustive search does not try.
bool is_cut(const Plan& plan) {
  return std::any_of(plan.sources.begin(), plan.sources.end(),
                     [](const PointSource& source) { return source.count > 1; });
}

bool is_part(const PlannedRead& planned) { return planned.read.gather != 0; }
bool is_block(const PlannedRead& planned) { return planned.read.gather == 2; }

struct GatheringPlans : ::testing::Test {
  GatheringCodec any_codec() {
    GatheringCodec codec;
    for (std::uint16_t space = 0; space < 2; ++space) {
      codec.ways[space] = {word_way(0, pick(3, 64)), word_way(1, pick(1, 2), 1)};
      if (pick(0, 9) == 0) codec.ways[space].erase(codec.ways[space].begin());
    }
    codec.commands = {{1, 100}};
    codec.prices = {{1, {pick(5, 40), pick(1, 12)}}, {2, {pick(5, 40), pick(1, 16)}}};
    return codec;
  }
  std::vector<Point> any_points(const Codec& codec) {
    std::vector<Point> points;
    for (std::uint32_t n = pick(1, 7); n > 0; --n) {
      const char* letter = pick(0, 2) == 0 ? "V" : "W";
      points.push_back(point(codec, letter + std::to_string(pick(0, 60)),
                             static_cast<std::uint16_t>(pick(1, 8) == 1 ? 2 : 1)));
      if (points.back().count == 2 && codec.addresses().read_ways(0).front().max_bits < 32)
        points.back().count = 1;
    }
    return points;
  }
  LineCost any_cost() { return {1ms, std::chrono::milliseconds(pick(0, 40))}; }
  /// Expects the least line time of random plans, with codecs that `change` alters. Returns the
  /// number of those that `counts`.
  std::size_t least_plans(const std::function<void(GatheringCodec&)>& change,
                          const std::function<bool(const Plan&)>& counts) {
    std::size_t counted = 0;
    for (int round = 0; round < 400; ++round) {
      GatheringCodec codec = any_codec();
      change(codec);
      const auto points = any_points(codec);
      const LineCost cost = any_cost();
      const Plan plan = checked_plan(codec, points, cost);
      if (is_cut(plan)) continue;
      EXPECT_EQ(plan.line_time.count(), EveryPlan(codec, points, cost).least()) << round;
      counted += counts(plan) ? 1U : 0U;
    }
    return counted;
  }

  Pick pick{20261123};
};

TEST_F(GatheringPlans, NoOtherMixOfBatchAndRandomReadsTakesLessLineTime) {
  const auto mixed = least_plans([](GatheringCodec&) {},
                                 [](const Plan& plan) {
                                   const auto parts = std::ranges::count_if(plan.reads, is_part);
                                   return parts > 0 && std::cmp_less(parts, plan.reads.size());
                                 });
  EXPECT_GT(mixed, 20U);
}

TEST_F(GatheringPlans, NorWhereAFrameHoldsFewParts) {
  const auto several = least_plans(
      [this](GatheringCodec& codec) {
        codec.commands = {{1, pick(1, 4)}};
      },
      [](const Plan& plan) {
        return plan.exchange_count() > 1 && std::ranges::any_of(plan.reads, is_part);
      });
  EXPECT_GT(several, 50U);
}

TEST_F(GatheringPlans, NorWhereThereAreTwoCommandsWithRoom) {
  const auto with_blocks = least_plans(
      [this](GatheringCodec& codec) {
        for (auto& [space, ways] : codec.ways) ways.push_back(word_way(2, pick(2, 20), 2));
        codec.commands = {{1, 100}, {2, 100}};
      },
      [](const Plan& plan) { return std::ranges::any_of(plan.reads, is_block); });
  EXPECT_GT(with_blocks, 20U);
}

TEST_F(GatheringPlans, WhereTheSizeOfAFrameCountsToFewTakeMore) {
  int worse = 0;
  for (int round = 0; round < 400; ++round) {
    GatheringCodec codec = any_codec();
    for (auto& [space, ways] : codec.ways) ways.push_back(word_way(2, 4, 2));
    codec.commands = {{1, pick(2, 6)}, {2, pick(2, 6), pick(4, 8) * 16}};
    const auto points = any_points(codec);
    const LineCost cost = any_cost();
    const Plan plan = checked_plan(codec, points, cost);
    if (is_cut(plan)) continue;
    const std::int64_t least = EveryPlan(codec, points, cost).least();
    ASSERT_GE(plan.line_time.count(), least) << round;
    const std::chrono::nanoseconds frames =
        2 * cost.per_exchange + cost.per_char * (codec.prices[1].fixed + codec.prices[2].fixed);
    ASSERT_LE(plan.line_time.count(), least + frames.count()) << round;
    worse += plan.line_time.count() > least ? 1 : 0;
  }
  RecordProperty("worse", worse);
  EXPECT_LT(worse, 20);
}

TEST_F(GatheringPlans, ABlockOfMoreThanHalfAFrameHasItsPrice) {
  const GatheringCodec codec = gathering_codec();
  const std::vector<Point> points{point(codec, "W100", 50), point(codec, "V900", 40),
                                  point(codec, "V30")};
  const Plan plan = checked_plan(codec, points, kCost);
  // 30 + 14 + 3 * 10 + 364 ms; single reads would take 3 * 40 + 364 ms.
  EXPECT_EQ(plan.exchange_count(), 1U);
  EXPECT_EQ(plan.line_time, 438ms);
}

// ---- large plans --------------------------------------------------------------------------------

TEST_F(GatheringPlans, ManyPartsFillTheirFrames) {
  GatheringCodec codec = gathering_codec();
  codec.commands = {{1, 24}};
  std::vector<Point> points;
  for (int n = 0; n < 240; ++n) points.push_back(point(codec, "W" + std::to_string(16 * n)));
  const LineCost cost{1ms, 100ms};
  const Plan plan = checked_plan(codec, points, cost);
  // A read of 64 words covers four of them in 238 ms; a frame covers 24 of them in 354 ms.
  EXPECT_EQ(plan.exchange_count(), 10U);
}

/// Its spaces are larger than any config needs.
GatheringCodec large_codec() {
  GatheringCodec codec = gathering_codec();
  for (auto& [space, ways] : codec.ways)
    for (ReadWay& way : ways) way.end_bit = 64'000'000;
  return codec;
}

/// Returns this many places, each at most `most` words after the previous one.
std::vector<Point> scattered(std::size_t places, std::uint32_t most) {
  std::minstd_rand random(20261123);
  std::vector<Point> points;
  std::uint32_t word = 0;
  for (std::size_t i = 0; i < places; ++i) {
    Point& point = points.emplace_back();
    const bool is_second = i >= places / 2;
    if (i == places / 2) word = 0;
    word += 1 + static_cast<std::uint32_t>(random()) % most;
    point.address = {is_second ? "V" : "W",
                     {is_second ? std::uint16_t{1} : std::uint16_t{0}, word * 16, 16},
                     Unit::word,
                     true};
    point.type = DataType::int16;
  }
  return points;
}

TEST_F(GatheringPlans, AHundredThousandPlacesTakeAFewLooksEach) {
  const GatheringCodec codec = large_codec();
  const auto points = scattered(100'000, 40);
  const Plan plan = make_plan(codec, points, kNoSpeed, 0);
  EXPECT_TRUE(plan.unreachable.empty());
  EXPECT_GT(plan.reads.size(), 50'000U);
  EXPECT_LT(plan.weighed, 20 * points.size());
}

TEST_F(GatheringPlans, NorDoPlacesThatLieClose) {
  const GatheringCodec codec = large_codec();
  const auto points = scattered(10'000, 2);
  const Plan plan = make_plan(codec, points, kCost, 0);
  EXPECT_LT(plan.reads.size(), 1000U);
  EXPECT_LT(plan.weighed, 150 * points.size());  // in many searches with 80 trials each
}

TEST_F(GatheringPlans, FramesThatAreFullAreNotLookedIntoAgainAndAgain) {
  GatheringCodec codec = large_codec();
  for (auto& [space, ways] : codec.ways) ways = {word_way(2, 64, 2)};
  for (auto& [space, ways] : codec.ways) ways.front().end_bit = 64'000'000;
  codec.commands = {{2, 1000, 96 * 16}};
  std::vector<Point> points = scattered(20'000, 400);
  for (Point& point : points) {
    point.count = static_cast<std::uint16_t>(pick(1, 40));
    point.is_array = point.count > 1;
  }
  const Plan plan = make_plan(codec, points, kCost, 0);
  EXPECT_GT(plan.exchange_count(), 4000U);
  EXPECT_LT(plan.weighed, 100 * points.size());
}

/// Returns the CPU time of a plan, the minimum of three runs.
std::clock_t time_of(const Codec& codec, const std::vector<Point>& points, const Holes& holes) {
  std::clock_t least = std::numeric_limits<std::clock_t>::max();
  for (int i = 0; i < 3; ++i) {
    const std::clock_t begin = std::clock();
    make_plan(codec, points, kNoSpeed, 0, holes);
    least = std::min(least, std::clock() - begin);
  }
  return least;
}

TEST_F(GatheringPlans, ThousandsOfHolesTakeLittleMoreTimeThanNone) {
  const GatheringCodec codec = large_codec();
  const auto points = scattered(1000, 10);
  Holes holes;
  for (int n = 0; n < 3000; ++n) {
    const std::uint32_t word = pick(0, 5000);
    holes.cuts.push_back({0, word * 16});
    holes.missing.push_back({1, word * 16, 16});
    holes.never_gathered.push_back({0, word * 16, 16});
    holes.suspects.push_back({1, word * 16, 16});
  }
  holes.most_suspects = 24;
  EXPECT_LT(time_of(codec, points, holes), 8 * time_of(codec, points, {}));
}

}  // namespace
}  // namespace fxagent::test
