// The reads of one space that a device refuses, or that would cross a border of the space: found in
// steps that grow with the logarithm of what is known. The planner's own (plan.h).
#pragma once

#include <cstdint>
#include <vector>

#include "protocol/plan.h"

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
  /// What of `holes` lies in the space, and its borders (AddressSpace::borders()).
  Forbidden(const Holes& holes, std::uint16_t space,
            const std::vector<std::uint32_t>& borders = {});

  /// Whether a read by `way` may not be this one. A read that holds a forbidden one is forbidden.
  bool forbids(const ReadWay& way, const Extent& read) const;
  /// Whether no read may be this one, by whatever way.
  bool holds(const Extent& read) const;

 private:
  std::vector<std::uint32_t> cuts_;  ///< rising
  std::vector<Extent> missing_;      ///< none holds another: both their starts and their ends rise
  std::vector<Extent> apart_;        ///< rising, none touches another
};

}  // namespace fxagent
