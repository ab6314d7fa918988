#include "protocol/value/raw.h"

#include <array>
#include <cmath>

namespace fxagent {
namespace {

// Scaling by doubles is exact up to here. Beyond it, rounding errors add up to a whole step.
constexpr double kMostScaled = kExactDouble / 16;
// More decimals than a double can show.
constexpr int kMaxDecimals = 17;

constexpr std::array<double, kMaxDecimals + 1> kPowers = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,
                                                          1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                                          1e12, 1e13, 1e14, 1e15, 1e16, 1e17};

double to_decimals(double value, int decimals) {
  if (decimals > kMaxDecimals) return value;
  const double power = kPowers[static_cast<std::size_t>(decimals)];
  const double shifted = value * power;
  return std::abs(shifted) < kExactDouble ? std::round(shifted) / power : value;
}

tl::unexpected<Error> not_finite() { return refuse("scaled value is not finite"); }

}  // namespace

Limits limits_of(DataType type, std::uint32_t bits) {
  if (is_bcd(type)) {
    std::uint64_t power = 1;
    for (std::uint32_t digit = 0; digit < bits / 4; ++digit) power *= 10;
    return {0, power - 1};
  }
  const std::uint64_t all_ones = ~std::uint64_t{0} >> (64 - bits);
  const bool is_signed =
      type == DataType::int16 || type == DataType::int32 || type == DataType::int64;
  // A group with fewer bits than its type is unsigned: K2M0 ranges from 0 to 255.
  if (!is_signed || bits < bits_of_type(type)) return {0, all_ones};
  return {-static_cast<std::int64_t>(all_ones >> 1) - 1, all_ones >> 1};
}

std::uint64_t reordered(std::uint64_t number, std::uint32_t bits, ByteOrder order) {
  constexpr std::uint32_t kWordBits = 16;
  const bool high_first = order == ByteOrder::abcd || order == ByteOrder::badc;
  const bool swapped = order == ByteOrder::badc || order == ByteOrder::dcba;
  std::uint64_t out = 0;
  for (std::uint32_t at = 0; at < bits; at += kWordBits) {
    std::uint64_t word = number >> at & 0xFFFF;
    if (swapped) word = (word & 0xFF) << 8 | word >> 8;
    out |= word << (high_first ? bits - kWordBits - at : at);
  }
  return out;
}

std::optional<std::int64_t> from_bcd(std::uint32_t raw) {
  std::int64_t value = 0;
  for (int shift = 28; shift >= 0; shift -= 4) {
    const std::uint32_t digit = raw >> shift & 0xF;
    if (digit > 9) return std::nullopt;
    value = value * 10 + digit;
  }
  return value;
}

std::uint32_t to_bcd(std::int64_t value) {
  std::uint32_t raw = 0;
  for (int shift = 0; shift < 32; shift += 4) {
    raw |= static_cast<std::uint32_t>(value % 10) << shift;
    value /= 10;
  }
  return raw;
}

Result<Scalar> scaled_whole(const Point& point, const Whole& raw) {
  if (!point.scaled()) return scalar_of(raw);
  const auto nearest = raw.convert_to<double>();
  const double exact = nearest * point.scale + point.offset;
  if (!std::isfinite(exact)) return not_finite();
  if (std::abs(nearest) >= kMostScaled || std::abs(exact) >= kMostScaled)
    return scaled_exactly(raw, point.scale, point.offset);
  return Scalar(to_decimals(exact, point.decimals));
}

Result<Scalar> scaled_real(const Point& point, double raw) {
  if (!point.scaled()) return Scalar(raw);
  const double value =
      to_decimals(raw * point.scale + point.offset, decimals_of(raw) + point.decimals);
  if (!std::isfinite(value)) return not_finite();
  return Scalar(value);
}

double unscaled(const Point& point, double value) {
  if (!point.scaled()) return value;
  const double raw = (value - point.offset) / point.scale;
  constexpr double kGrid = 1e6;
  return std::abs(raw) * kGrid < kExactDouble ? std::round(raw * kGrid) / kGrid : raw;
}

Whole nearest_raw(const Point& point, const Scalar& scalar) {
  const double value = as_double(scalar);
  const double raw = unscaled(point, value);
  if (std::abs(value) < kMostScaled && std::abs(raw) < kMostScaled) return Whole(std::llround(raw));
  return unscaled_exactly(scalar, point.scale, point.offset);
}

}  // namespace fxagent
