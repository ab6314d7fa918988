#include "agent/uplink/sparkplug/metric.h"

#include <bit>
#include <cmath>
#include <cstddef>
#include <string_view>
#include <utility>
#include <variant>

#include "agent/json_writer.h"
#include "agent/text.h"
#include "agent/uplink/sparkplug/sparkplug.pb.h"

namespace fxagent::sparkplug {
namespace {

Type scalar_type(DataType type, bool scaled) {
  if (scaled) return Type::real64;
  switch (type) {
    case DataType::boolean:
      return Type::boolean;
    case DataType::int16:
      return Type::int16;
    case DataType::uint16:
    case DataType::bcd16:
      return Type::uint16;
    case DataType::int32:
      return Type::int32;
    case DataType::uint32:
    case DataType::bcd32:
      return Type::uint32;
    case DataType::int64:
      return Type::int64;
    case DataType::uint64:
      return Type::uint64;
    case DataType::float32:
      return Type::real32;
    case DataType::float64:
      return Type::real64;
    case DataType::string:
      return Type::string;
  }
  return Type::string;
}

/// Number of an array type, less that of its elements.
constexpr int kArray = 21;
static_assert(static_cast<int>(Type::boolean_array) == static_cast<int>(Type::boolean) + kArray);
static_assert(static_cast<int>(Type::string_array) == static_cast<int>(Type::string) + kArray);

Type array_of(Type type) { return static_cast<Type>(static_cast<int>(type) + kArray); }
Type element_of(Type type) { return static_cast<Type>(static_cast<int>(type) - kArray); }
bool is_array(Type type) { return type >= Type::int16_array; }

std::size_t bytes_of(Type type) {
  switch (type) {
    case Type::int16:
    case Type::uint16:
      return 2;
    case Type::int32:
    case Type::uint32:
    case Type::real32:
      return 4;
    default:
      return 8;
  }
}

/// Returns the 64 bits of an integer; nullopt if it is not one.
std::optional<std::uint64_t> integer_bits(const Scalar& scalar) {
  if (const auto* number = std::get_if<std::int64_t>(&scalar))
    return static_cast<std::uint64_t>(*number);
  const auto* big = std::get_if<BigInteger>(&scalar);
  return big == nullptr ? std::nullopt : number_from<std::uint64_t>(big->digits);
}

/// Returns the element as the number of little-endian bytes that its type has in an array.
std::optional<std::uint64_t> packed_bits(const Scalar& scalar, Type type) {
  if (type == Type::real32 || type == Type::real64) {
    const auto number = number_of(scalar);
    if (!number) return std::nullopt;
    if (type == Type::real64) return std::bit_cast<std::uint64_t>(*number);
    return std::bit_cast<std::uint32_t>(static_cast<float>(*number));
  }
  return integer_bits(scalar);
}

std::optional<std::string> packed(const Scalars& items, Type type) {
  std::string out;
  const auto put = [&out](std::uint64_t bits, std::size_t bytes) {
    for (std::size_t i = 0; i < bytes; ++i) out += static_cast<char>((bits >> (8 * i)) & 0xFF);
  };
  if (type == Type::boolean) {
    put(items.size(), 4);
    for (std::size_t i = 0; i < items.size(); ++i) {
      const auto* bit = std::get_if<bool>(&items[i]);
      if (bit == nullptr) return std::nullopt;
      if (i % 8 == 0) out += '\0';
      if (*bit) out.back() = static_cast<char>(out.back() | (0x80 >> (i % 8)));
    }
    return out;
  }
  for (const Scalar& item : items) {
    if (const auto* text = std::get_if<std::string>(&item); text != nullptr) {
      if (type != Type::string) return std::nullopt;
      out += *text;
      out += '\0';
      continue;
    }
    const auto bits = packed_bits(item, type);
    if (!bits || type == Type::string) return std::nullopt;
    put(*bits, bytes_of(type));
  }
  return out;
}

/// Returns false if the type cannot hold the value.
bool set_scalar(Metric& metric, const Scalar& scalar, Type type) {
  switch (type) {
    case Type::boolean:
      if (!std::holds_alternative<bool>(scalar)) return false;
      metric.set_boolean_value(std::get<bool>(scalar));
      return true;
    case Type::string:
      if (!std::holds_alternative<std::string>(scalar)) return false;
      metric.set_string_value(std::get<std::string>(scalar));
      return true;
    case Type::real32:
    case Type::real64: {
      const auto number = number_of(scalar);
      if (!number) return false;
      if (type == Type::real64)
        metric.set_double_value(*number);
      else
        metric.set_float_value(static_cast<float>(*number));
      return true;
    }
    default:
      break;
  }
  const auto bits = integer_bits(scalar);
  if (!bits) return false;
  // The specification has UInt32 in int_value; the hosts that we know read it from long_value.
  if (type == Type::int16 || type == Type::uint16 || type == Type::int32)
    metric.set_int_value(static_cast<std::uint32_t>(*bits));
  else
    metric.set_long_value(*bits);
  return true;
}

PropertyValue& add_property(Metric& metric, std::string_view name, Type type) {
  PropertySet& set = *metric.mutable_properties();
  set.add_keys(std::string(name));
  PropertyValue& value = *set.add_values();
  value.set_type(static_cast<std::uint32_t>(type));
  return value;
}

}  // namespace

Quality quality_of(const std::optional<BadReason>& bad) {
  if (!bad) return Quality::good;
  return *bad == BadReason::timeout || *bad == BadReason::link_down ? Quality::stale : Quality::bad;
}

Type type_of(const Point& point) {
  const Type type = scalar_type(point.type, point.scaled());
  return point.is_array ? array_of(type) : type;
}

Type type_of(const RecordedReading& reading) {
  const Type type = scalar_type(reading.type, reading.scaled);
  return reading.value.is_array ? array_of(type) : type;
}

void set_value(Metric& metric, const Value& value, Type type) {
  if (value.is_array && is_array(type)) {
    if (auto bytes = packed(value.items, element_of(type)))
      return metric.set_bytes_value(std::move(*bytes));
  } else if (!value.is_array && !value.items.empty() && !is_array(type)) {
    if (set_scalar(metric, value.items[0], type)) return;
  }
  metric.set_is_null(true);
}

void add_quality(Metric& metric, const std::optional<BadReason>& bad) {
  add_property(metric, "quality", Type::int32)
      .set_int_value(static_cast<std::uint32_t>(quality_of(bad)));
  if (bad) add_property(metric, "why", Type::string).set_string_value(std::string(to_string(*bad)));
}

void add_units(Metric& metric, const TagConfig& tag) {
  const TagUnits& units = *tag.units;
  const auto add_text = [&](std::string_view name, const std::string& text) {
    if (!text.empty()) add_property(metric, name, Type::string).set_string_value(text);
  };
  add_text("engUnit", units.unit);
  add_text("documentation", units.description);
  if (units.limits.min)
    add_property(metric, "engLow", Type::real64).set_double_value(*units.limits.min);
  if (units.limits.max)
    add_property(metric, "engHigh", Type::real64).set_double_value(*units.limits.max);
  add_property(metric, "readOnly", Type::boolean).set_boolean_value(!tag.writable);
}

std::optional<std::string> json_of(const Metric& metric, Type type) {
  json::Writer out;
  switch (metric.value_case()) {
    case Metric::kIntValue:
      if (type == Type::boolean) {
        out.boolean(metric.int_value() != 0);
      } else if (type == Type::uint16 || type == Type::uint32 || type == Type::uint64) {
        out.integer(std::uint64_t{metric.int_value()});
      } else {
        out.integer(std::int64_t{static_cast<std::int32_t>(metric.int_value())});
      }
      break;
    case Metric::kLongValue:
      if (type == Type::uint32 || type == Type::uint64)
        out.integer(std::uint64_t{metric.long_value()});
      else
        out.integer(static_cast<std::int64_t>(metric.long_value()));
      break;
    case Metric::kFloatValue:
      out.number(metric.float_value());
      break;
    case Metric::kDoubleValue:
      out.number(metric.double_value());
      break;
    case Metric::kBooleanValue:
      out.boolean(metric.boolean_value());
      break;
    case Metric::kStringValue:
      out.string(metric.string_value());
      break;
    case Metric::kBytesValue:
    case Metric::VALUE_NOT_SET:
      return std::nullopt;
  }
  return out.take();
}

}  // namespace fxagent::sparkplug
