// Exact decimal arithmetic for large raw and scaled values. raw.cpp has doubles for smaller ones.
#pragma once

#include <boost/multiprecision/cpp_int.hpp>
#include <compare>
#include <optional>
#include <string_view>

#include "protocol/value/value.h"

namespace fxagent {

/// An integer of any size.
using Whole = boost::multiprecision::number<boost::multiprecision::cpp_int_backend<>,
                                            boost::multiprecision::et_off>;

/// A double distinguishes neighbouring integers up to ±2^53.
inline constexpr double kExactDouble = 9007199254740992.0;

/// Returns the decimal places of the shortest spelling: 2 for 0.05, 7 for 1e-7, 0 for 3.
int decimals_of(double number);

/// Parses an optional minus and at most 40 digits without leading zeros. nullopt: another text.
std::optional<Whole> whole_from(std::string_view text);

/// Returns an int64 if `number` fits, otherwise a BigInteger.
Scalar scalar_of(const Whole& number);

/// Returns raw × scale + offset: a double up to ±2^53, beyond that the nearest integer. `scale` and
/// `offset` must be finite. Each counts as its shortest decimal spelling, so 0.1 is one tenth.
Scalar scaled_exactly(const Whole& raw, double scale, double offset);

/// Returns (value − offset) ÷ scale, rounded to the nearest integer, ties away from zero. `value`
/// must be a number, not a text, and `scale` must not be 0.
Whole unscaled_exactly(const Scalar& value, double scale, double offset);

/// Compares two numbers, neither a text nor NaN or infinite.
std::strong_ordering compare_exactly(const Scalar& one, const Scalar& other);

}  // namespace fxagent
