#include "agent/uplink/sparkplug/metric.h"

#include <string_view>

#include "agent/uplink/sparkplug/sparkplug.pb.h"

namespace fxagent::sparkplug {
namespace {

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

void set_value(Metric& metric, const Value& value, Type type) {
  put(metric, typed(value, type), [&](auto integer) {
    // The specification has UInt32 in int_value; the hosts that we know read it from long_value.
    if (type == Type::int16 || type == Type::uint16 || type == Type::int32)
      metric.set_int_value(static_cast<std::uint32_t>(integer));
    else
      metric.set_long_value(static_cast<std::uint64_t>(integer));
  });
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
  if (metric.is_null()) return std::nullopt;
  switch (metric.value_case()) {
    case Metric::kIntValue:
      if (type == Type::boolean) return json_of(TypedValue(metric.int_value() != 0), type);
      if (is_unsigned(type)) return json_of(TypedValue(std::uint64_t{metric.int_value()}), type);
      return json_of(TypedValue(std::int64_t{static_cast<std::int32_t>(metric.int_value())}), type);
    case Metric::kLongValue:
      if (is_unsigned(type)) return json_of(TypedValue(std::uint64_t{metric.long_value()}), type);
      return json_of(TypedValue(static_cast<std::int64_t>(metric.long_value())), type);
    case Metric::kFloatValue:
      return json_of(TypedValue(metric.float_value()), type);
    case Metric::kDoubleValue:
      return json_of(TypedValue(metric.double_value()), type);
    case Metric::kBooleanValue:
      return json_of(TypedValue(metric.boolean_value()), type);
    case Metric::kStringValue:
      return json_of(TypedValue(metric.string_value()), type);
    case Metric::kBytesValue:
      // The elements would be read as others.
      if (metric.datatype() != 0 && metric.datatype() != static_cast<std::uint32_t>(type)) break;
      return json_of(TypedValue(Packed{metric.bytes_value()}), type);
    case Metric::VALUE_NOT_SET:
      break;
  }
  return std::nullopt;
}

}  // namespace fxagent::sparkplug
