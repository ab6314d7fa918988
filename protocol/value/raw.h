// Numbers as a device stores them: size, range, byte order, BCD, and scale. Only for the files of
// this room.
#pragma once

#include <cstdint>
#include <optional>

#include "protocol/value/exact_number.h"
#include "protocol/value/point.h"
#include "protocol/value/value.h"

namespace fxagent {

inline bool is_float(DataType type) {
  return type == DataType::float32 || type == DataType::float64;
}
inline bool is_bcd(DataType type) { return type == DataType::bcd16 || type == DataType::bcd32; }

/// Range of the raw integer of one element. It always includes zero.
struct Limits {
  std::int64_t min = 0;
  std::uint64_t max = 0;
};
Limits limits_of(DataType type, std::uint32_t bits);

/// Converts between the number in image order (the first word is the lowest) and the value in the
/// device's order. Its own inverse.
std::uint64_t reordered(std::uint64_t number, std::uint32_t bits, ByteOrder order);

/// Returns the BCD digits of `raw` as a number; nullopt if a nibble is above 9.
std::optional<std::int64_t> from_bcd(std::uint32_t raw);
std::uint32_t to_bcd(std::int64_t value);

/// Returns the index of character number `i` of a string in its image. Two characters fill a word.
/// The first is the low byte unless the order puts the most significant byte first.
inline std::size_t character_at(std::size_t i, ByteOrder order) {
  return order == ByteOrder::abcd ? i ^ 1U : i;
}

/// Returns raw × scale + offset with at most the decimals that scale and offset can produce. Error:
/// bad_request if it is not finite.
Result<Scalar> scaled_whole(const Point& point, const Whole& raw);
Result<Scalar> scaled_real(const Point& point, double raw);

/// Returns (value − offset) ÷ scale. Corrects a quotient that misses a decimal only by the error of
/// binary fractions, so that 23.45 ÷ 0.1 is the exact tie 234.5.
double unscaled(const Point& point, double value);
/// Returns (value − offset) ÷ scale as the nearest raw integer, of any size.
Whole nearest_raw(const Point& point, const Scalar& scalar);

}  // namespace fxagent
