#include "protocol/plan/plan.h"

#include <gtest/gtest.h>

#include <random>

#include "protocol/fx/programming_port.h"
#include "protocol/plan/cheapest_reads.h"
#include "tests/protocol/checked_plan.h"
#include "tests/protocol/gathering_codec.h"
#include "tests/support/pick.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using fx::Model;
using fx::ProgrammingPort;
using test::checked_plan;

/// A made-up protocol whose ways the test chooses: 10 characters and two per byte.
class PaperCodec final : public test::GatheringCodec {
 public:
  explicit PaperCodec(std::vector<ReadWay> of_words, Recovery after_silence = Recovery::drain)
      : after_silence_(after_silence) {
    ways[0] = std::move(of_words);
  }
  std::uint32_t max_write_bits(std::uint16_t space) const override { return space == 0 ? 128 : 0; }
  Recovery after_silence() const override { return after_silence_; }
  LineLength line_length(const Request& request) const override {
    const auto& read = std::get<Read>(request);
    // The second way takes one character per bit, like bit reads of the computer link.
    return {5, 5 + (read.way == 1 ? read.span.bits : (read.span.bits + 3) / 4), 0};
  }

 private:
  Recovery after_silence_;
};

const LineCost kCost{1ms, 30ms};

Point words(std::uint32_t number, std::uint16_t count = 1, DataType type = DataType::int16) {
  return {.address = {"W" + std::to_string(number), {0, number * 16, 16}, Unit::word, true},
          .type = type,
          .count = count,
          .is_array = count > 1};
}

Point bits(std::uint32_t number, std::uint16_t count = 1) {
  return {.address = {"B" + std::to_string(number), {0, number, 1}, Unit::bit, true},
          .type = DataType::boolean,
          .count = count,
          .is_array = count > 1};
}

Point device(const Codec& codec, std::string_view address, DataType type = DataType::int16,
             std::uint16_t count = 1) {
  return {.address = *codec.addresses().parse_address(address, type),
          .type = type,
          .count = count,
          .is_array = count > 1};
}

ReadWay way(std::uint32_t end, std::uint32_t align, std::uint32_t unit, std::uint32_t max,
            std::uint32_t gap = 0xFFFFFFFF, std::uint8_t id = 0) {
  return {id, 0, 0, end, align, unit, max, gap};
}

// ---- order ------------------------------------------------------------------------------------

/// The words of each read in the order of sending. `lengths`: those of points far from each other.
std::vector<std::uint32_t> sent(const Codec& codec, const std::vector<std::uint16_t>& lengths) {
  std::vector<Point> points;
  for (const std::uint16_t length : lengths)
    points.push_back(words(static_cast<std::uint32_t>(1000 * points.size()), length));
  const Plan plan = checked_plan(codec, points, kCost);
  std::vector<bool> once(plan.reads.size());
  std::vector<std::uint32_t> out;
  for (std::uint32_t e = 0; e < plan.exchange_count(); ++e) {
    const ReadIndices reads = plan.exchanges[e];
    EXPECT_FALSE(once[reads[0]]) << "read " << reads[0] << " is sent twice";
    once[reads[0]] = true;
    out.push_back(plan.reads[reads[0]].read.span.bits / 16);
  }
  return out;
}

TEST(Plan, NeighboursWithoutNumbersDifferInLength) {
  using Lengths = std::vector<std::uint32_t>;
  const std::vector<ReadWay> ways = {way(1U << 20U, 16, 16, 64 * 16, 0)};
  const PaperCodec bare(ways);
  EXPECT_EQ(sent(bare, {2, 2, 4, 4}), (Lengths{2, 4, 2, 4}));
  EXPECT_EQ(sent(bare, {2, 4, 4}), (Lengths{4, 2, 4})) << "the larger half begins";
  EXPECT_EQ(sent(bare, {2, 2, 4, 4, 6, 6}), (Lengths{2, 4, 2, 6, 4, 6}));
  EXPECT_EQ(sent(bare, {2, 4, 2, 4}), (Lengths{2, 4, 2, 4}));
  EXPECT_EQ(sent(bare, {2, 2, 2}), (Lengths{2, 2, 2}));
  EXPECT_EQ(sent(bare, {1, 1, 100}), (Lengths{1, 1, 36, 64})) << "an array is not torn";
  const PaperCodec numbered(ways, Recovery::none);
  EXPECT_EQ(sent(numbered, {2, 2, 4, 4}), (Lengths{2, 2, 4, 4}));
}

// ---- merging ----------------------------------------------------------------------------------

struct PlanOfAnFx3u : ::testing::Test {
  const ProgrammingPort codec = ProgrammingPort({Model::fx3u});
};

TEST_F(PlanOfAnFx3u, NeighboursShareOneRead) {
  const std::vector<Point> points = {device(codec, "D100"), device(codec, "D105"),
                                     device(codec, "D102", DataType::int32)};
  const Plan plan = checked_plan(codec, points, kCost);
  ASSERT_EQ(plan.reads.size(), 1U);
  EXPECT_EQ(plan.reads[0].read.span, (Span{fx::id(fx::Space::d), 1600, 96}));
  EXPECT_EQ(plan.reads[0].points, (std::vector<std::uint32_t>{0, 1, 2}));
}

TEST_F(PlanOfAnFx3u, AGapIsReadWhereThatIsCheaperThanAnotherExchange) {
  const LineCost cost{1ms, 30ms};
  // A second read costs 30 ms, 11 characters out and 4 around the answer: 45 ms, as much as 11
  // words.
  const auto reads = [&](const char* second) {
    return make_plan(codec, std::vector{device(codec, "D0"), device(codec, second)}, cost, 0)
        .reads.size();
  };
  EXPECT_EQ(reads("D12"), 1U);
  EXPECT_EQ(reads("D13"), 2U);
}

TEST(Plan, WhereOneReadCostsAsMuchAsTwoOneIsTaken) {
  // A second read costs 1 ms, 11 characters out and 4 around the answer: 16 ms, as much as 4 words.
  const ProgrammingPort codec({Model::fx3u});
  const LineCost cost{1ms, 1ms};
  const auto plan_of = [&](std::vector<const char*> names) {
    std::vector<Point> points;
    for (const char* name : names) points.push_back(device(codec, name));
    return make_plan(codec, points, cost, 0);
  };
  const Plan whole = plan_of({"D0", "D5"});
  ASSERT_EQ(whole.line_time, 2 * plan_of({"D0"}).line_time) << "this is a tie";
  EXPECT_EQ(whole.reads.size(), 1U);
  EXPECT_EQ(plan_of({"D0", "D5", "D10", "D15"}).reads.size(), 1U);
}

TEST(Plan, BitsAreReadByTheirByteAndNotBeyondTheLastDevice) {
  const ProgrammingPort codec({Model::fx1s});
  const std::vector<Point> points = {device(codec, "Y15", DataType::boolean),
                                     device(codec, "Y12", DataType::boolean)};
  const Plan plan = make_plan(codec, points, kCost, 0);
  ASSERT_EQ(plan.reads.size(), 1U);
  EXPECT_EQ(plan.reads[0].read.span, (Span{fx::id(fx::Space::y), 8, 8}));
}

TEST_F(PlanOfAnFx3u, TiersAndSpacesAreNeverMixed) {
  const std::vector<Point> points = {device(codec, "D1023"), device(codec, "D1024"),
                                     device(codec, "D8000"),
                                     device(codec, "M0", DataType::boolean)};
  const Plan plan = checked_plan(codec, points, LineCost{1ms, 1s});
  ASSERT_EQ(plan.reads.size(), 4U);
  EXPECT_EQ(plan.reads[plan.sources[0].first_read].read.way, ProgrammingPort::kClassicWay);
  EXPECT_EQ(plan.reads[plan.sources[1].first_read].read.way, ProgrammingPort::kExtendedWay);
}

TEST_F(PlanOfAnFx3u, AValueThatCrossesTheClassicReachIsReadWholeByTheExtendedSet) {
  const std::vector<Point> points = {device(codec, "D1023", DataType::int32)};
  const Plan plan = make_plan(codec, points, kCost, 0);
  ASSERT_EQ(plan.reads.size(), 1U);
  EXPECT_EQ(plan.reads[0].read.way, ProgrammingPort::kExtendedWay);
}

TEST(Plan, WhatNoWayReachesIsListedAndTheRestIsRead) {
  const ProgrammingPort codec({Model::unknown_fx});
  std::vector<Point> points = {device(codec, "D2000"), device(codec, "D5")};
  points.push_back(words(0));
  points.back().address.span.space = 99;
  points.push_back(device(codec, "D6"));
  points.back().type = DataType::boolean;  // does not fit a word
  const Plan plan = make_plan(codec, points, kCost, 0);
  EXPECT_EQ(plan.unreachable, (std::vector<std::uint32_t>{0, 2, 3}));
  EXPECT_EQ(plan.sources[0].count, 0U);
  EXPECT_EQ(plan.reads.size(), 1U);
  const std::vector<Bytes> images = {{0x2A, 0x00}};
  EXPECT_EQ(value_of(plan, images, points[1], 1), Value(Scalar(std::int64_t{42})));
  for (const std::size_t index : {0U, 99U}) {
    EXPECT_EQ(test::error_of(value_of(plan, images, points[0], index)).code,
              ErrorCode::unsupported);
  }
  EXPECT_FALSE(value_of(plan, {}, points[1], 1));
}

TEST_F(PlanOfAnFx3u, NothingToReadIsAnEmptyPlan) {
  const Plan plan = make_plan(codec, {}, kCost, 0);
  EXPECT_TRUE(plan.reads.empty());
  EXPECT_EQ(plan.line_time, 0ns);
}

TEST(Plan, AGapThatIsTooWideIsNotReadHoweverCheap) {
  const LineCost cost{1ns, 1s};
  const auto reads = [&](std::uint32_t gap) {
    const PaperCodec codec({way(16000, 16, 16, 1600, gap)});
    const std::vector<Point> points = {words(0, 10), words(3), words(14), words(40)};
    const Plan plan = checked_plan(codec, points, cost);
    return plan.reads.size();
  };
  EXPECT_EQ(reads(0), 3U);
  EXPECT_EQ(reads(63), 3U);
  EXPECT_EQ(reads(64), 2U);  // four words between W9 and W14
  EXPECT_EQ(reads(25 * 16 - 1), 2U);
  EXPECT_EQ(reads(25 * 16), 1U);
}

TEST(Plan, AUnitThatWouldStickOutBehindTheLastDeviceStartsEarlier) {
  // Sixteen bits per unit in steps of eight; the space ends half way through a unit.
  const PaperCodec codec({way(1016, 8, 16, 512)});
  const std::vector<Point> points = {bits(1010)};
  const Plan plan = checked_plan(codec, points, kCost);
  EXPECT_EQ(plan.reads[0].read.span, (Span{0, 1000, 16}));
  // This way cannot read a space smaller than one unit.
  const PaperCodec tiny({way(8, 8, 16, 512)});
  EXPECT_EQ(make_plan(tiny, points, kCost, 0).unreachable.size(), 1U);
  EXPECT_EQ(make_plan(tiny, std::vector{bits(3)}, kCost, 0).unreachable.size(), 1U);
  // Nor a space that its reads would have to start before.
  ReadWay late = way(64, 16, 16, 64);
  late.first_bit = 8;
  EXPECT_EQ(make_plan(PaperCodec({late}), std::vector{bits(9)}, kCost, 0).unreachable.size(), 1U);
}

TEST(Plan, TheCheaperWayOfATierIsTaken) {
  ReadWay bit_way = way(4096, 1, 1, 256, 0xFFFFFFFF, 1);
  const PaperCodec codec({way(4096, 16, 16, 512), bit_way});
  const auto used = [&](const std::vector<Point>& points) {
    const Plan plan = checked_plan(codec, points, kCost);
    return plan.reads.at(0).read.way;
  };
  EXPECT_EQ(used({bits(5)}), 1);            // one character instead of four
  EXPECT_EQ(used({bits(5), bits(40)}), 0);  // twelve instead of thirty-six
}

TEST_F(PlanOfAnFx3u, MaxBlockBytesLowersEveryRead) {
  std::vector<Point> points;
  for (int n = 0; n < 40; ++n) points.push_back(device(codec, "D" + std::to_string(n)));
  const LineCost cost{1ns, 1s};
  EXPECT_EQ(make_plan(codec, points, cost, 0).reads.size(), 2U);
  for (const std::uint32_t bytes : {1U, 2U, 3U, 20U, 64U, 500U}) {
    const Plan plan = checked_plan(codec, points, cost, bytes);
    const std::size_t per_read = std::max(1U, std::min(bytes, 64U) / 2);
    EXPECT_EQ(plan.reads.size(), (40 + per_read - 1) / per_read) << bytes;
  }
}

// ---- values longer than a frame ----------------------------------------------------------------

TEST_F(PlanOfAnFx3u, AnArrayLongerThanAFrameGetsConsecutiveReadsAndComesBackWhole) {
  const std::vector<Point> points = {device(codec, "D10", DataType::int16, 100)};
  const Plan plan = checked_plan(codec, points, kCost);
  EXPECT_EQ(plan.reads.size(), 4U);
  EXPECT_EQ(plan.sources[0].count, 4U);
  std::vector<Bytes> images;
  for (const PlannedRead& planned : plan.reads) {
    Bytes image;
    for (std::uint32_t n = planned.read.span.first_bit / 16; n < planned.read.span.end_bit() / 16;
         ++n) {
      image.push_back(static_cast<std::uint8_t>(n));
      image.push_back(0x01);
    }
    images.push_back(image);
  }
  const auto value = value_of(plan, images, points[0], 0);
  ASSERT_TRUE(value) << value.error().text;
  ASSERT_EQ(value->items.size(), 100U);
  for (std::size_t i = 0; i < 100; ++i)
    EXPECT_EQ(value->items[i], Scalar(static_cast<std::int64_t>(0x100 + 10 + i)));
  images[2].clear();
  test::expect_says(test::error_of(value_of(plan, images, points[0], 0)).text, "only partly read");
}

TEST_F(PlanOfAnFx3u, AValueIsNeverTakenFromAReadThatEndsBeforeIt) {
  const auto value_from = [&](std::uint32_t first, std::uint32_t words, const Point& point) {
    Plan plan;
    plan.reads.resize(1);
    plan.reads[0].read.span = {id(fx::Space::d), first * 16, words * 16};
    plan.sources = {{0, 1}};
    const std::vector<Bytes> images = {Bytes(2 * words, 0x11)};
    return value_of(plan, images, point, 0).has_value();
  };
  EXPECT_TRUE(value_from(10, 2, device(codec, "D10", DataType::int32)));
  EXPECT_FALSE(value_from(10, 1, device(codec, "D10", DataType::int32)));
  EXPECT_FALSE(value_from(10, 1, device(codec, "D11")));
  EXPECT_FALSE(value_from(11, 1, device(codec, "D10")));
  EXPECT_FALSE(value_from(10, 2, device(codec, "D10", DataType::int16, 3)));
}

TEST_F(PlanOfAnFx3u, ALongArraySharesItsReadsWithItsNeighbours) {
  const LineCost cost{1ns, 1s};
  // 21 + 40 words: two reads if the array is cut to fit its neighbours, otherwise three.
  const std::vector<Point> points = {device(codec, "D0", DataType::int16, 21),
                                     device(codec, "D21", DataType::int16, 40)};
  const Plan plan = checked_plan(codec, points, cost);
  EXPECT_EQ(plan.reads.size(), 2U);
}

TEST_F(PlanOfAnFx3u, TheElementsOfALongArrayAreNotTorn) {
  for (const std::uint32_t bytes : {6U, 10U, 64U}) {
    const std::vector<Point> points = {device(codec, "D1", DataType::int32, 40)};
    const Plan plan = checked_plan(codec, points, kCost, bytes);
    for (std::uint32_t i = 0; i < 40; ++i) {
      const Span element{fx::id(fx::Space::d), 16 + i * 32, 32};
      EXPECT_TRUE(std::any_of(plan.reads.begin(), plan.reads.end(), [&](const PlannedRead& read) {
        return read.read.span.contains(element);
      })) << i;
    }
  }
}

TEST_F(PlanOfAnFx3u, AnElementLargerThanAFrameIsCutAtUnits) {
  Point text = device(codec, "D0", DataType::string);
  text.length = 100;
  const std::vector<Point> points = {text, device(codec, "D5")};
  const Plan plan = checked_plan(codec, points, kCost);
  EXPECT_EQ(plan.sources[0].count, 2U);
  EXPECT_EQ(plan.sources[1].count, 1U);
  std::vector<Bytes> images;
  for (const PlannedRead& planned : plan.reads)
    images.emplace_back(planned.read.span.bits / 8, 'A');
  EXPECT_EQ(value_of(plan, images, text, 0), Value(Scalar(std::string(100, 'A'))));
}

TEST(Plan, ALongBitArrayComesBackWhole) {
  const PaperCodec codec({way(4096, 1, 1, 100)});
  const std::vector<Point> points = {bits(3, 250)};
  const Plan plan = checked_plan(codec, points, kCost);
  ASSERT_EQ(plan.reads.size(), 3U);
  std::vector<Bytes> images;
  for (const PlannedRead& planned : plan.reads) {
    Bytes image((planned.read.span.bits + 7) / 8, 0);
    for (std::uint32_t i = 0; i < planned.read.span.bits; ++i)
      if ((planned.read.span.first_bit + i) % 3 == 0)
        image[i / 8] |= static_cast<std::uint8_t>(1U << (i % 8));
    images.push_back(image);
  }
  const auto value = value_of(plan, images, points[0], 0).value();
  for (std::size_t i = 0; i < 250; ++i) EXPECT_EQ(value.items[i], Scalar((i + 3) % 3 == 0)) << i;
}

// ---- comparison with the exhaustive search -----------------------------------------------------

/// Returns the shortest line time over all distributions of points among reads, contiguous or not.
std::int64_t brute_force(const Codec& codec, const std::vector<Point>& points, const LineCost& cost,
                         const Holes& holes = {}) {
  const auto ways = codec.addresses().read_ways(0);
  // Bits that a read covers because of its byte or word granularity do not count as a gap.
  std::uint32_t grain = 0;
  for (const ReadWay& w : ways) grain = std::gcd(grain, std::gcd(w.align_bits, w.unit_bits));
  std::vector<Span> spans;
  for (const Point& point : points) {
    Span span = *span_of(point);
    const std::uint32_t end = (span.end_bit() + grain - 1) / grain * grain;
    span.first_bit -= span.first_bit % grain;
    span.bits = end - span.first_bit;
    spans.push_back(span);
  }
  const auto price = [&](std::uint32_t members) {
    std::uint32_t first = 0xFFFFFFFF;
    std::uint32_t end = 0;
    for (std::size_t i = 0; i < spans.size(); ++i) {
      if ((members >> i & 1) == 0) continue;
      first = std::min(first, spans[i].first_bit);
      end = std::max(end, spans[i].end_bit());
    }
    std::int64_t best = std::numeric_limits<std::int64_t>::max();
    for (const ReadWay& w : ways) {
      for (std::uint32_t start = 0; start <= first; start += w.align_bits) {
        const std::uint32_t length = (end - start + w.unit_bits - 1) / w.unit_bits * w.unit_bits;
        if (length > w.max_bits || start + length > w.end_bit) continue;
        // Unrequested bits in one run between two requested ones.
        std::uint32_t run = 0;
        bool too_wide = false;
        for (std::uint32_t bit = first; bit < end; ++bit) {
          const bool asked = std::any_of(spans.begin(), spans.end(), [&](const Span& s) {
            return s.first_bit <= bit && bit < s.end_bit();
          });
          run = asked ? 0 : run + 1;
          too_wide |= run > w.max_gap_bits;
        }
        bool known = false;
        for (const Holes::Cut& cut : holes.cuts) known |= start < cut.at && cut.at < start + length;
        for (const Span& hole : holes.missing)
          known |= start <= hole.first_bit && hole.end_bit() <= start + length;
        if (!too_wide && !known)
          best = std::min<std::int64_t>(
              best, cost.of(codec.line_length(Read{{0, start, length}, w.way})).count());
      }
    }
    return best;
  };
  std::vector<std::int64_t> prices(std::size_t{1} << points.size());
  for (std::uint32_t members = 1; members < prices.size(); ++members)
    prices[members] = price(members);
  std::vector<std::int64_t> least(prices.size(), std::numeric_limits<std::int64_t>::max());
  least[0] = 0;
  for (std::uint32_t all = 1; all < least.size(); ++all)
    for (std::uint32_t part = all; part != 0; part = (part - 1) & all)
      if (prices[part] != std::numeric_limits<std::int64_t>::max() &&
          least[all & ~part] != std::numeric_limits<std::int64_t>::max())
        least[all] = std::min(least[all], least[all & ~part] + prices[part]);
  return least.back();
}

TEST(Plan, NoOtherSharingOfThePointsTakesLessLineTime) {
  test::Pick pick(20240607);
  for (int round = 0; round < 400; ++round) {
    const bool of_bits = round % 2 == 0;
    std::vector<ReadWay> ways;
    if (of_bits) {
      ways.push_back(
          way(512, 8, 8, pick(2, 10) * 8, round % 3 == 0 ? pick(8, 64) / 8 * 8 : 0xFFFFFFFF));
      if (round % 4 == 0) ways.push_back(way(512, 1, 1, 64, 0xFFFFFFFF, 1));
    } else {
      ways.push_back(
          way(1024, 16, 16, pick(4, 12) * 16, round % 3 == 0 ? pick(0, 5) * 16 : 0xFFFFFFFF));
    }
    const PaperCodec codec(ways);
    const LineCost cost{std::chrono::milliseconds(1), std::chrono::milliseconds(pick(0, 40))};
    std::vector<Point> points;
    for (std::uint32_t n = pick(1, 7); n > 0; --n) {
      if (of_bits)
        points.push_back(bits(pick(0, 200), static_cast<std::uint16_t>(pick(1, 9))));
      else
        points.push_back(words(pick(0, 40), static_cast<std::uint16_t>(pick(1, 3))));
    }
    const Plan plan = checked_plan(codec, points, cost);
    ASSERT_EQ(plan.line_time.count(), brute_force(codec, points, cost)) << "round " << round;
  }
}

TEST(Plan, NoOtherSharingOfThePointsAroundTheHolesTakesLessLineTime) {
  test::Pick pick(20240608);
  std::size_t refused = 0;
  for (int round = 0; round < 400; ++round) {
    const bool of_bits = round % 2 == 0;
    const std::uint32_t unit = of_bits ? 8 : 16;
    const PaperCodec codec({way(1024, unit, unit, pick(2, 12) * unit)});
    const LineCost cost{std::chrono::milliseconds(1), std::chrono::milliseconds(pick(0, 40))};
    std::vector<Point> points;
    for (std::uint32_t n = pick(1, 7); n > 0; --n)
      points.push_back(of_bits ? bits(pick(0, 120)) : words(pick(0, 20)));
    Holes holes;
    for (std::uint32_t n = pick(0, 3); n > 0; --n) holes.cuts.push_back({0, pick(0, 16) * unit});
    for (std::uint32_t n = pick(0, 3); n > 0; --n)
      holes.missing.push_back({0, pick(0, 16) * unit, pick(1, 3) * unit});
    const Plan plan = checked_plan(codec, points, cost, 0, holes);
    for (const PlannedRead& planned : plan.reads) {
      const Span& span = planned.read.span;
      EXPECT_FALSE(Forbidden(holes, span.space).forbids({}, {span.first_bit, span.end_bit()}));
    }
    std::vector<Point> readable;
    for (std::uint32_t i = 0; i < points.size(); ++i) {
      const bool is_refused = std::binary_search(plan.refused.begin(), plan.refused.end(), i);
      EXPECT_EQ(is_refused, plan.sources[i].count == 0);
      if (!is_refused) {
        readable.push_back(points[i]);
        continue;
      }
      ++refused;
      EXPECT_EQ(brute_force(codec, {points[i]}, cost, holes),
                std::numeric_limits<std::int64_t>::max());
    }
    ASSERT_EQ(plan.line_time.count(), brute_force(codec, readable, cost, holes)) << round;
  }
  EXPECT_GT(refused, 20U);
}

// ---- borders ------------------------------------------------------------------------------------

// A clone of the FX2N stores M1536 and above elsewhere. It answers a read across that border with
// the bits that follow M1535 in its own memory.
TEST(Plan, NoReadOfAnFx2nGoesAcrossM1536) {
  const auto plan_for = [](Model model) {
    const ProgrammingPort codec({model, ProgrammingPort::Commands::extended, 64});
    std::vector<Point> points;
    for (const char* name : {"M1530", "M1535", "M1536", "M1540"})
      points.push_back(device(codec, name, DataType::boolean));
    return make_plan(codec, points, kCost, 0);
  };
  const Plan plan = plan_for(Model::fx2n);
  ASSERT_EQ(plan.reads.size(), 2U);
  EXPECT_EQ(plan.reads[0].read.span, (Span{fx::id(fx::Space::m), 1528, 8}));
  EXPECT_EQ(plan.reads[1].read.span, (Span{fx::id(fx::Space::m), 1536, 8}));
  EXPECT_EQ(plan.reads[0].points, (std::vector<std::uint32_t>{0, 1}));
  EXPECT_EQ(plan.reads[1].points, (std::vector<std::uint32_t>{2, 3}));
  // The FX3 has another map.
  EXPECT_EQ(plan_for(Model::fx3u).reads.size(), 1U);
}

TEST(Plan, AllMOfAnFx2nTakeNoMoreReadsForTheBorder) {
  const ProgrammingPort codec({Model::fx2n, ProgrammingPort::Commands::extended, 64});
  const std::vector<Point> points = {device(codec, "M0", DataType::boolean, 3072)};
  EXPECT_EQ(make_plan(codec, points, kCost, 0).reads.size(), 3072U / (64 * 8));
}

TEST(Plan, APointAcrossM1536IsReadInTwoPartsAndPutTogether) {
  const ProgrammingPort codec({Model::fx2n});
  const std::vector<Point> points = {device(codec, "K8M1520", DataType::int32),
                                     device(codec, "M1534", DataType::boolean, 4)};
  const Plan plan = make_plan(codec, points, kCost, 0);
  ASSERT_TRUE(plan.unreachable.empty());
  ASSERT_TRUE(plan.refused.empty());
  ASSERT_EQ(plan.reads.size(), 2U);
  EXPECT_EQ(plan.reads[0].read.span.end_bit(), 1536U);
  EXPECT_EQ(plan.reads[1].read.span.first_bit, 1536U);
  const std::vector<Bytes> images = {{0x34, 0x92}, {0x56, 0x78}};
  EXPECT_EQ(value_of(plan, images, points[0], 0)->items.front(), Scalar(std::int64_t{0x78569234}));
  EXPECT_EQ(*image_of(plan, images, points[1], 1), Bytes{0b1010});
}

TEST(Plan, ReadsOfManyBitsAroundM1536TakeTheLeastLineTimeThatTheBorderLeaves) {
  test::Pick pick(1536);
  const ProgrammingPort codec({Model::fx2n, ProgrammingPort::Commands::extended, 16});
  const std::uint16_t space = fx::id(fx::Space::m);
  for (int round = 0; round < 200; ++round) {
    std::vector<Point> points;
    std::vector<Point> sides[2];
    for (std::uint32_t n = pick(1, 7); n > 0; --n) {
      points.push_back(bits(pick(1400, 1650)));
      points.back().address.span.space = space;
      sides[points.back().address.span.first_bit < 1536 ? 0 : 1].push_back(points.back());
    }
    const Plan plan = make_plan(codec, points, kCost, 0);
    for (const PlannedRead& planned : plan.reads) {
      const Span& span = planned.read.span;
      EXPECT_FALSE(span.first_bit < 1536 && 1536 < span.end_bit()) << span.first_bit;
      EXPECT_TRUE(codec.encode(planned.read, 0));
    }
    // The two sides are independent.
    EXPECT_EQ(plan.line_time, make_plan(codec, sides[0], kCost, 0).line_time +
                                  make_plan(codec, sides[1], kCost, 0).line_time);
  }
}

// ---- holes --------------------------------------------------------------------------------------

TEST(Plan, AReadIsCutBetweenElementsNearestToItsMiddle) {
  const PaperCodec codec({way(4096, 16, 16, 2048)});
  const std::vector<Point> points = {words(0), words(1, 2), words(3, 1, DataType::int32), words(9)};
  const Plan plan = make_plan(codec, points, kCost, 0);
  ASSERT_EQ(plan.reads.size(), 1U);
  // Ten words; the middle is 5. Word 3 begins two words before it, word 9 four words after it.
  EXPECT_EQ(halves_of(codec, points, plan.reads[0]), (Halves{3 * 16, 3 * 16}));
  const std::vector<Point> one = {words(3, 1, DataType::int32)};
  EXPECT_EQ(halves_of(codec, one, make_plan(codec, one, kCost, 0).reads[0]), std::nullopt);
}

TEST(Plan, BitsAreCutWhereBothHalvesCanBeRead) {
  const PaperCodec codec({way(4096, 8, 8, 2048)});
  const std::vector<Point> apart = {bits(3), bits(14), bits(30)};
  EXPECT_EQ(halves_of(codec, apart, make_plan(codec, apart, kCost, 0).reads[0]), (Halves{8, 8}));
  const std::vector<Point> together = {bits(3), bits(5)};  // one byte holds both
  EXPECT_EQ(halves_of(codec, together, make_plan(codec, together, kCost, 0).reads[0]),
            std::nullopt);
}

TEST(Plan, AnArrayIsCutBetweenItsElementsAndPutTogetherAgain) {
  const PaperCodec codec({way(4096, 16, 16, 2048)});
  const std::vector<Point> points = {words(0, 6)};
  Holes holes;
  holes.cuts.push_back(
      {0, halves_of(codec, points, make_plan(codec, points, kCost, 0).reads[0])->right_first});
  EXPECT_EQ(holes.cuts[0].at, 3 * 16U);
  const Plan plan = make_plan(codec, points, kCost, 0, holes);
  ASSERT_EQ(plan.reads.size(), 2U);
  const std::vector<Bytes> images = {{1, 0, 2, 0, 3, 0}, {4, 0, 5, 0, 6, 0}};
  EXPECT_EQ(*image_of(plan, images, points[0], 0), (Bytes{1, 0, 2, 0, 3, 0, 4, 0, 5, 0, 6, 0}));
  EXPECT_EQ(value_of(plan, images, points[0], 0)->items.back(), Scalar(std::int64_t{6}));
}

TEST(Plan, ALimitThatWasFoundHoldsForItsSpace) {
  const PaperCodec codec({way(4096, 16, 16, 2048)});
  const std::vector<Point> points = {words(0, 20)};
  Holes holes;
  holes.limits.push_back({0, 5 * 16});
  EXPECT_EQ(make_plan(codec, points, kCost, 0, holes).reads.size(), 4U);
  holes.limits.front().space = 1;
  EXPECT_EQ(make_plan(codec, points, kCost, 0, holes).reads.size(), 1U);
}

TEST(Plan, APointOfWhichAPartIsMissingIsRefusedWhole) {
  const PaperCodec codec({way(4096, 16, 16, 2048)});
  const std::vector<Point> points = {words(0), words(4, 4), words(9)};
  Holes holes;
  holes.missing.push_back({0, 5 * 16, 16});
  const Plan plan = make_plan(codec, points, kCost, 0, holes);
  EXPECT_EQ(plan.refused, std::vector<std::uint32_t>{1});
  EXPECT_EQ(plan.sources[1].count, 0U);
  EXPECT_EQ(plan.reads.size(), 2U);  // no read may include word 5
}

TEST(Plan, AHundredThousandPointsTakeAFewLooksEach) {
  const ProgrammingPort codec({Model::fx3u, ProgrammingPort::Commands::extended, 254});
  std::mt19937 random(7);
  std::vector<Point> points;
  for (int i = 0; i < 100000; ++i) {
    Point point = i % 2 == 0
                      ? words(static_cast<std::uint32_t>(random() % 7998), 1, DataType::int32)
                      : bits(static_cast<std::uint32_t>(random() % 7680));
    point.address.span.space = fx::id(i % 2 == 0 ? fx::Space::d : fx::Space::m);
    points.push_back(std::move(point));
  }
  const Plan plan = make_plan(codec, points, kCost, 0);
  EXPECT_TRUE(plan.unreachable.empty());
  // 960 bytes of M take 4 reads of up to 254. Any two neighbours among the 8,000 D belong to one
  // int32, so each read of 127 words shares its last word with the next: 8,000 take 64.
  EXPECT_EQ(plan.reads.size(), 68U);
  EXPECT_LT(plan.weighed, 8U * (8000 + 960));
}

// ---- writes -------------------------------------------------------------------------------------

TEST(PlanWrite, ABitIsForcedAndWordsAreWritten) {
  const ProgrammingPort codec({Model::fx3u});
  const auto forced = plan_write(codec, device(codec, "M100", DataType::boolean), Bytes{1}).value();
  EXPECT_EQ(forced, (std::vector<Request>{Force{fx::id(fx::Space::m), 100, true}}));
  const auto written = plan_write(codec, device(codec, "D200"), Bytes{0x34, 0x12}).value();
  EXPECT_EQ(written, (std::vector<Request>{Write{{fx::id(fx::Space::d), 3200, 16}, {0x34, 0x12}}}));
}

TEST(PlanWrite, ALongArrayIsSentInFramesThatKeepItsElementsWhole) {
  const ProgrammingPort codec({Model::fx3u});
  Bytes image(200);
  for (std::size_t i = 0; i < image.size(); ++i) image[i] = static_cast<std::uint8_t>(i);
  for (const auto& [point, most] : {std::pair(device(codec, "D0", DataType::int32, 50), 64U),
                                    {device(codec, "D0", DataType::int16, 100), 64U}}) {
    const auto requests = plan_write(codec, point, image).value();
    EXPECT_EQ(requests.size(), 4U);
    Bytes sent;
    for (const Request& request : requests) {
      const auto& write = std::get<Write>(request);
      EXPECT_EQ(write.span.first_bit, sent.size() * 8);
      EXPECT_LE(write.image.size(), most);
      sent.insert(sent.end(), write.image.begin(), write.image.end());
    }
    EXPECT_EQ(sent, image);
  }
  // 6 bytes per frame would hold one and a half int32.
  const ProgrammingPort narrow({Model::fx3u, ProgrammingPort::Commands::automatic, 6});
  const auto pieces = plan_write(narrow, device(codec, "D0", DataType::int32, 3), Bytes(12));
  EXPECT_EQ(pieces->size(), 3U);
}

TEST(PlanWrite, NoWriteToAnFx2nGoesAcrossM1536) {
  const ProgrammingPort codec({Model::fx2n});
  const std::uint16_t m = fx::id(fx::Space::m);
  const auto requests =
      plan_write(codec, device(codec, "K8M1520", DataType::int32), Bytes{0x34, 0x92, 0x56, 0x78});
  ASSERT_TRUE(requests);
  EXPECT_EQ(*requests, (std::vector<Request>{Write{{m, 1520, 16}, {0x34, 0x92}},
                                             Write{{m, 1536, 16}, {0x56, 0x78}}}));
  for (const Request& request : *requests) EXPECT_TRUE(codec.encode(request, 0));
}

TEST(PlanWrite, WhatCannotBeWrittenIsRefused) {
  const ProgrammingPort codec({Model::fx3u});
  const auto why = [&](const Point& point, std::size_t bytes) {
    return test::error_of(plan_write(codec, point, Bytes(bytes))).text;
  };
  test::expect_says(why(device(codec, "D100.F", DataType::boolean), 1), "cannot be written");
  test::expect_says(why(device(codec, "K4M1"), 2), "whole bytes");
  test::expect_says(why(device(codec, "M8036", DataType::boolean), 1), "M8118");
  test::expect_says(why(device(codec, "D0"), 4), "takes 2 bytes, not 4");
  test::expect_says(why(device(codec, "D7999", DataType::int16, 2), 4), "does not exist");
  Point misfit = device(codec, "D0");
  misfit.type = DataType::boolean;
  test::expect_says(why(misfit, 1), "cannot be read as bool");
  Point elsewhere = words(0);
  elsewhere.address.span.space = 1;
  EXPECT_FALSE(plan_write(PaperCodec({}), elsewhere, Bytes(2)));
}

TEST(PlanWrite, ElementsThatAreNotWholeBytesAreCutAtTheFrame) {
  const Point groups{
      .address = {"K1", {0, 0, 4}, Unit::bit_group, true}, .count = 64, .is_array = true};
  EXPECT_EQ(plan_write(PaperCodec({}), groups, Bytes(32)).value().size(), 2U);
}

}  // namespace
}  // namespace fxagent
