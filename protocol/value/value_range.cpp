#include "protocol/value/value_range.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "protocol/value/raw.h"

namespace fxagent {

std::optional<ValueRange> value_range(const Point& point) {
  const std::uint32_t bits = element_bits(point);
  if (bits == 0 || point.type == DataType::boolean || point.type == DataType::string)
    return std::nullopt;
  ValueRange range;
  if (is_float(point.type)) {
    const double most = std::abs(point.scale) * (point.type == DataType::float32
                                                     ? double{std::numeric_limits<float>::max()}
                                                     : std::numeric_limits<double>::max());
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
