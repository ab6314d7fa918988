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
  // Codes of the specification. Stale: the device does not answer. Bad: it answers, and not with a
  // value.
  constexpr std::uint32_t kGood = 192;
  constexpr std::uint32_t kStale = 500;
  constexpr std::uint32_t kBad = 0;
  const bool is_stale = bad == BadReason::timeout || bad == BadReason::link_down;
  add_property(metric, "quality", Type::int32)
      .set_int_value(!bad       ? kGood
                     : is_stale ? kStale
                                : kBad);
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
  // The elements of another type would be read as others.
  const bool is_other_array = metric.has_bytes_value() && metric.datatype() != 0 &&
                              metric.datatype() != static_cast<std::uint32_t>(type);
  if (metric.is_null() || is_other_array) return std::nullopt;
  const auto integer = [&]() -> TypedValue {
    if (metric.has_int_value() && type == Type::boolean) return metric.int_value() != 0;
    if (metric.has_int_value() && !is_unsigned(type))
      return std::int64_t{static_cast<std::int32_t>(metric.int_value())};
    if (metric.has_int_value()) return std::uint64_t{metric.int_value()};
    if (!metric.has_long_value()) return {};
    if (is_unsigned(type)) return std::uint64_t{metric.long_value()};
    return static_cast<std::int64_t>(metric.long_value());
  };
  return json_of(taken(metric, integer), type);
}

}  // namespace fxagent::sparkplug
