// Compares values, spells them for human-readable texts, and returns the range of a point.
#pragma once

#include <compare>
#include <cstdint>
#include <optional>
#include <string>

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

/// Returns the nearest double of a number; nullopt for a bool or a text.
std::optional<double> number_of(const Scalar& scalar);
/// Compares two numbers exactly, even if their nearest doubles are equal. A bool counts as 0 or 1.
/// Returns nullopt if either is a text.
std::optional<std::partial_ordering> compare(const Scalar& one, const Scalar& other);

/// Returns the shortest spelling that reads back as the same number: "1000", "0.5".
std::string spelled(double number);
/// The same for any number or bool. Returns a text unchanged.
std::string spelled(const Scalar& scalar);

}  // namespace fxagent
