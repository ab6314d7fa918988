// Reads of one space that the planner must avoid: those the device refuses, and those that cross a
// border of the space. A lookup takes logarithmic time. Used only by the planner (plan.h).
#pragma once

#include <cstdint>
#include <vector>

#include "protocol/plan/plan.h"

namespace fxagent {

/// [first, end) in bits of a space.
struct Extent {
  std::uint32_t first = 0;
  std::uint32_t end = 0;
  friend bool operator==(const Extent&, const Extent&) = default;
};

class Forbidden final {
 public:
  Forbidden() = default;
  /// Collects the `holes` that lie in `space`, and the space's `borders` (AddressSpace::borders()).
  Forbidden(const Holes& holes, std::uint16_t space,
            const std::vector<std::uint32_t>& borders = {});

  /// True if `way` must not make this read. A read that contains a forbidden one is forbidden.
  bool forbids(const ReadWay& way, const Extent& read) const;
  /// True if no way may make this read.
  bool holds(const Extent& read) const;

 private:
  std::vector<std::uint32_t> cuts_;  ///< ascending
  std::vector<Extent> missing_;      ///< none contains another: starts and ends both ascend
  std::vector<Extent> apart_;        ///< ascending; no two touch
};

}  // namespace fxagent
