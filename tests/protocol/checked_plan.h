// Plans whose rules are checked, for the tests of the planner.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>

#include "protocol/plan/plan.h"

namespace fxagent::test {

/// Makes a plan and checks the rules for every plan: the limits of its ways and commands, each read
/// sent once, whole values, and the stated line time.
inline Plan checked_plan(const Codec& codec, const std::vector<Point>& points, const LineCost& cost,
                         std::uint32_t max_bytes = 0, const Holes& holes = {}) {
  Plan plan = make_plan(codec, points, cost, max_bytes, holes);
  std::chrono::nanoseconds time{0};
  std::vector<int> sent(plan.reads.size());
  for (std::uint32_t e = 0; e < plan.exchange_count(); ++e) {
    const ReadIndices which = plan.exchanges[e];
    for (std::size_t i = 0; i < which.size(); ++i) ++sent[which[i]];
    const Request request = plan.request(which);
    time += cost.of(codec.line_length(request));
    const auto* gather = std::get_if<Gather>(&request);
    if (gather == nullptr) continue;
    std::uint32_t bits = 0;
    for (const Read& part : gather->parts) {
      EXPECT_EQ(part.gather, gather->parts.front().gather);
      bits += part.span.bits;
    }
    for (const GatherCommand& command : codec.addresses().gathers())
      if (command.gather == gather->parts.front().gather) {
        EXPECT_LE(gather->parts.size(), command.max_parts);
        EXPECT_LE(bits, command.max_bits);
      }
  }
  EXPECT_EQ(sent, std::vector<int>(plan.reads.size(), 1));
  EXPECT_EQ(plan.line_time, time);
  for (const PlannedRead& planned : plan.reads) {
    const Span& span = planned.read.span;
    EXPECT_TRUE(std::ranges::any_of(
        codec.addresses().read_ways(span.space),
        [&](const ReadWay& way) {
          return way.way == planned.read.way && way.gather == planned.read.gather &&
                 span.first_bit >= way.first_bit && span.end_bit() <= way.end_bit &&
                 span.first_bit % way.align_bits == 0 && span.bits % way.unit_bits == 0 &&
                 span.bits > 0 && span.bits <= way.max_bits &&
                 (max_bytes == 0 || span.bits <= std::max(max_bytes * 8, way.unit_bits));
        }))
        << span.first_bit << "+" << span.bits;
    EXPECT_FALSE(planned.points.empty());
  }
  EXPECT_EQ(plan.sources.size(), points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const PointSource& source = plan.sources.at(i);
    const Span span = *span_of(points[i]);
    std::uint32_t covered = span.first_bit;
    for (std::uint32_t r = source.first_read; r < source.first_read + source.count; ++r) {
      const PlannedRead& planned = plan.reads[r];
      if (planned.read.span.first_bit <= covered)
        covered = std::max(covered, planned.read.span.end_bit());
      EXPECT_NE(std::ranges::count(planned.points, i), 0);
    }
    if (source.count != 0) {
      EXPECT_GE(covered, span.end_bit()) << i;
    }
  }
  return plan;
}

}  // namespace fxagent::test
