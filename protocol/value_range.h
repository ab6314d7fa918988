// Compares values, spells them in texts for people, and says what values a point can have at all.
#pragma once

#include <compare>
#include <cstdint>
#include <optional>
#include <string>

#include "protocol/point.h"

namespace fxagent {

/// What the values of one element can be, in engineering units.
struct ValueRange {
  double least = 0;
  double greatest = 0;
  double step = 0;  ///< from one value to the next; 0 for floats, whose steps differ
};
/// nullopt for bool and string, and where the type does not fit the address unit.
std::optional<ValueRange> value_range(const Point& point);
/// How many values of one element lie within these limits, which count; nullopt where there is no
/// value_range() with one step.
std::optional<std::int64_t> values_within(const Point& point, std::optional<double> min,
                                          std::optional<double> max);

/// The nearest double of a number; nullopt for a bool and a text.
std::optional<double> number_of(const Scalar& scalar);
/// Compares two numbers exactly, also where their nearest doubles are equal. A bool counts as 0 or
/// 1. nullopt where one is a text.
std::optional<std::partial_ordering> compare(const Scalar& one, const Scalar& other);

/// "1000", "0.5": as short as it can be said and read back.
std::string spelled(double number);
/// The same of any number or bool; a text as it is.
std::string spelled(const Scalar& scalar);

}  // namespace fxagent
