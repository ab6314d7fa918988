#include "protocol/value/point.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "protocol/value/raw.h"

namespace fxagent {
namespace {

// By DataType.
constexpr auto kTypes =
    std::to_array<std::string_view>({"bool", "int16", "uint16", "int32", "uint32", "float32",
                                     "bcd16", "bcd32", "string", "int64", "uint64", "float64"});
constexpr auto kBits = std::to_array<std::uint32_t>({1, 16, 16, 32, 32, 32, 16, 32, 0, 64, 64, 64});
static_assert(kTypes.size() == static_cast<std::size_t>(DataType::float64) + 1);
static_assert(kBits.size() == kTypes.size());
// By ByteOrder.
constexpr auto kOrders = std::to_array<std::string_view>({"ABCD", "CDAB", "BADC", "DCBA"});

/// The largest float32, with the digits that samples have.
constexpr double kLargestSingle = 3.4028235e38;

/// Returns the types that fit the address, the default one first.
std::string types_of(const Address& address) {
  switch (address.unit) {
    case Unit::long_index:
      return "int32 or uint32";
    case Unit::long_count:
      return "uint32 or int32";
    case Unit::word:
      return "a number or string";
    default:
      return std::string(to_string(default_type(address)));
  }
}

}  // namespace

std::string_view to_string(DataType type) { return kTypes[static_cast<std::size_t>(type)]; }

Result<DataType> data_type_from(std::string_view word) {
  const auto known = std::ranges::find(kTypes, word);
  if (known != kTypes.end()) return static_cast<DataType>(known - kTypes.begin());
  std::string all;
  for (const std::string_view type : kTypes) all += " " + std::string(type);
  return refuse("'" + std::string(word) + "' is not a type; types are" + all);
}

Result<ByteOrder> byte_order_from(std::string_view word) {
  if (word == "high_first") return ByteOrder::abcd;
  if (word == "low_first") return ByteOrder::cdab;
  const auto known = std::ranges::find(kOrders, word);
  if (known != kOrders.end()) return static_cast<ByteOrder>(known - kOrders.begin());
  return refuse("'" + std::string(word) +
                "' is not an order; orders are low_first high_first ABCD CDAB BADC DCBA");
}

std::string_view to_string(ByteOrder order) { return kOrders[static_cast<std::size_t>(order)]; }

DataType default_type(const Address& address) {
  switch (address.unit) {
    case Unit::bit:
    case Unit::word_bit:
      return DataType::boolean;
    case Unit::dword:
    case Unit::long_index:
      return DataType::int32;
    case Unit::long_count:
      return DataType::uint32;
    case Unit::bit_group:
      return address.span.bits > 16 ? DataType::int32 : DataType::int16;
    case Unit::word:
      break;
  }
  return DataType::int16;
}

Result<void> set_units(Point& point, double scale, double offset) {
  if (!std::isfinite(scale) || !std::isfinite(offset) || scale == 0.0)
    return refuse("scale and offset are finite numbers, and scale is not 0");
  const bool plain = scale == 1.0 && offset == 0.0;
  if (!plain && (point.type == DataType::boolean || point.type == DataType::string))
    return refuse(std::string(to_string(point.type)) + " takes no scale and no offset");
  point.scale = scale;
  point.offset = offset;
  // Values are rounded to at most 17 decimals.
  constexpr int kMost = std::numeric_limits<std::int8_t>::max();
  point.decimals =
      static_cast<std::int8_t>(std::min(kMost, std::max(decimals_of(scale), decimals_of(offset))));
  return {};
}

std::uint32_t bits_of_type(DataType type) { return kBits[static_cast<std::size_t>(type)]; }

std::uint32_t element_bits(const Point& point) {
  const std::uint32_t bits = bits_of_type(point.type);
  switch (point.address.unit) {
    case Unit::bit:
    case Unit::word_bit:
      return point.type == DataType::boolean ? 1 : 0;
    case Unit::word:
      if (point.type == DataType::boolean) return 0;
      return point.type == DataType::string ? (point.length + 1U) / 2 * 16 : bits;
    case Unit::dword:
      return point.type == DataType::int32 ? 32 : 0;
    case Unit::long_index:
    case Unit::long_count:
      return point.type == DataType::int32 || point.type == DataType::uint32 ? 32 : 0;
    case Unit::bit_group: {
      const std::uint32_t group = point.address.span.bits;
      const bool fits = group <= 16 ? bits == 16 : point.type == DataType::int32;
      return fits ? group : 0;
    }
  }
  return 0;
}

Result<Span> span_of(const Point& point) {
  if (point.type == DataType::string && point.length == 0)
    return refuse("a string needs a length of at least 1 character");
  if (point.count == 0) return refuse("an array has at least 1 element");
  const std::uint32_t bits = element_bits(point);
  if (bits == 0)
    return refuse(point.address.text + " cannot be read as " + std::string(to_string(point.type)) +
                  "; its type must be " + types_of(point.address));
  const std::uint64_t total = std::uint64_t{bits} * point.count;
  if (point.address.span.first_bit + total > std::numeric_limits<std::uint32_t>::max())
    return refuse(point.address.text + ": the array is too long");
  return Span{point.address.span.space, point.address.span.first_bit,
              static_cast<std::uint32_t>(total)};
}

std::optional<ValueRange> value_range(const Point& point) {
  const std::uint32_t bits = element_bits(point);
  if (bits == 0 || point.type == DataType::boolean || point.type == DataType::string)
    return std::nullopt;
  ValueRange range;
  if (is_float(point.type)) {
    const double most =
        std::abs(point.scale) *
        (point.type == DataType::float32 ? kLargestSingle : std::numeric_limits<double>::max());
    range.least = point.offset - most;
    range.greatest = point.offset + most;
    return range;
  }
  const auto value_of_raw = [&](const Whole& raw) {
    const auto value = scaled_whole(point, raw);
    return value ? as_double(*value) : raw.convert_to<double>() * point.scale + point.offset;
  };
  const Limits limits = limits_of(point.type, bits);
  range.least = point.scale < 0 ? value_of_raw(limits.max) : value_of_raw(limits.min);
  range.greatest = point.scale < 0 ? value_of_raw(limits.min) : value_of_raw(limits.max);
  range.step = std::abs(point.scale);
  return range;
}

std::optional<std::int64_t> values_within(const Point& point, std::optional<double> min,
                                          std::optional<double> max) {
  const auto range = value_range(point);
  if (!range || range->step == 0) return std::nullopt;
  // Clamp limits outside the range to its ends.
  const double first = std::clamp(min.value_or(range->least), range->least, range->greatest);
  const double last = std::clamp(max.value_or(range->greatest), range->least, range->greatest);
  if ((min && *min > range->greatest) || (max && *max < range->least) || first > last) return 0;
  double low = unscaled(point, first);
  double high = unscaled(point, last);
  if (point.scale < 0) std::swap(low, high);
  const double count = std::floor(high) - std::ceil(low) + 1;
  if (!std::isfinite(count) || std::abs(count) > kExactDouble) return std::nullopt;
  return static_cast<std::int64_t>(count);
}

}  // namespace fxagent
