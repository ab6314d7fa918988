// The range of the values of a point.
#pragma once

#include <cstdint>
#include <optional>

#include "protocol/value/point.h"

namespace fxagent {

/// Range of the values of one element, in engineering units.
struct ValueRange {
  double least = 0;
  double greatest = 0;
  double step = 0;  ///< distance between neighbouring values; 0 for floats, whose steps vary
};
/// Returns nullopt for bool and string, and if the type does not fit the address unit.
std::optional<ValueRange> value_range(const Point& point);
/// Returns the number of values of one element within these limits, both inclusive. nullopt if
/// value_range() has no single step.
std::optional<std::int64_t> values_within(const Point& point, std::optional<double> min,
                                          std::optional<double> max);

}  // namespace fxagent
