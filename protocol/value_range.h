// What values a point can have at all: the range of its type in engineering units, and how texts
// about values spell a number. point.cpp has it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "protocol/point.h"

namespace fxagent {

/// What the values of one element can be, in engineering units.
struct ValueRange {
  double least = 0;
  double greatest = 0;
  double step = 0;  ///< from one value to the next; 0 for float32, whose steps differ
};
/// nullopt for bool and string, and where the type does not fit the address unit.
std::optional<ValueRange> value_range(const Point& point);
/// How many values of one element lie within these limits, which count; nullopt where there is no
/// value_range() with one step.
std::optional<std::int64_t> values_within(const Point& point, std::optional<double> min,
                                          std::optional<double> max);

/// "1000", "0.5": as short as it can be said and read back.
std::string spelled(double number);

}  // namespace fxagent
