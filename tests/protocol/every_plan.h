// The shortest line time of a plan by exhaustive search, to compare the planner with.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <numeric>
#include <vector>

#include "protocol/plan/plan.h"

namespace fxagent::test {

/// Tries every distribution of points among reads, and of reads among frames.
class EveryPlan {
 public:
  EveryPlan(const Codec& codec, const std::vector<Point>& points, const LineCost& cost)
      : codec_(codec), cost_(cost), all_((1U << points.size()) - 1) {
    for (const Point& each : points) {
      Span span = *span_of(each);
      std::uint32_t grain = 0;  // read granularity in bits
      for (const ReadWay& way : codec.addresses().read_ways(span.space))
        grain = std::gcd(grain, std::gcd(way.align_bits, way.unit_bits));
      const std::uint32_t end = (span.end_bit() + grain - 1) / grain * grain;
      span.first_bit -= span.first_bit % grain;
      span.bits = end - span.first_bit;
      spans_.push_back(span);
    }
  }

  std::int64_t least() {
    std::vector<std::int64_t> alone(all_ + 1, kNever);
    for (std::uint32_t set = 1; set <= all_; ++set) {
      for (const Read& read : reads_of(set, 0))
        alone[set] = std::min(alone[set], cost_.of(codec_.line_length(read)).count());
      for (const GatherCommand& command : codec_.addresses().gathers()) {
        Gather gather;
        best_ = kNever;
        cover(set, command, gather, 0);
        alone[set] = std::min(alone[set], best_);
      }
    }
    std::vector<std::int64_t> least(all_ + 1, kNever);
    least[0] = 0;
    for (std::uint32_t set = 1; set <= all_; ++set)
      for (std::uint32_t part = set; part != 0; part = (part - 1) & set)
        if (alone[part] != kNever && least[set & ~part] != kNever)
          least[set] = std::min(least[set], least[set & ~part] + alone[part]);
    return least[all_];
  }

 private:
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

  /// Tries to complete one frame for the whole set, starting with the parts in `gather`.
  void cover(std::uint32_t set, const GatherCommand& command, Gather& gather, std::uint32_t bits) {
    if (bits > command.max_bits || gather.parts.size() > command.max_parts) return;
    if (set == 0) {
      best_ = std::min(best_, cost_.of(codec_.line_length(gather)).count());
      return;
    }
    const std::uint32_t lowest = set & (~set + 1);
    const std::uint32_t others = set & ~lowest;
    for (std::uint32_t more = others;; more = (more - 1) & others) {
      for (const Read& part : reads_of(lowest | more, command.gather)) {
        gather.parts.push_back(part);
        cover(others & ~more, command, gather, bits + part.span.bits);
        gather.parts.pop_back();
      }
      if (more == 0) break;
    }
  }

  /// The shortest reads that cover the set with the command's ways.
  std::vector<Read> reads_of(std::uint32_t set, std::uint8_t gather) const {
    Span whole;
    bool first = true;
    for (std::size_t i = 0; i < spans_.size(); ++i) {
      if ((set >> i & 1) == 0) continue;
      if (!first && spans_[i].space != whole.space) return {};
      const std::uint32_t end =
          first ? spans_[i].end_bit() : std::max(whole.end_bit(), spans_[i].end_bit());
      whole.first_bit =
          first ? spans_[i].first_bit : std::min(whole.first_bit, spans_[i].first_bit);
      whole.space = spans_[i].space;
      whole.bits = end - whole.first_bit;
      first = false;
    }
    std::vector<Read> out;
    for (const ReadWay& way : codec_.addresses().read_ways(whole.space)) {
      const std::uint32_t start = whole.first_bit - whole.first_bit % way.align_bits;
      const std::uint32_t units = (whole.end_bit() - start + way.unit_bits - 1) / way.unit_bits;
      const std::uint32_t bits = units * way.unit_bits;
      if (way.gather == gather && bits <= way.max_bits && start + bits <= way.end_bit)
        out.push_back({{whole.space, start, bits}, way.way, gather});
    }
    return out;
  }

  const Codec& codec_;
  const LineCost cost_;
  const std::uint32_t all_;
  std::vector<Span> spans_;
  std::int64_t best_ = kNever;
};

}  // namespace fxagent::test
