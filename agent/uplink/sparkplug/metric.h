// Values of tags as metrics of Sparkplug B, and metrics of commands as JSON. The fields are those
// of Sparkplug 3.0, section 6.4. Pure functions, any thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "agent/config/model.h"
#include "agent/handover/telemetry.h"
#include "agent/uplink/sparkplug/typed_value.h"

namespace fxagent::sparkplug {

class Metric;

/// Sets the value, or is_null if there is none or the type cannot hold it.
void set_value(Metric& metric, const Value& value, Type type);
/// Adds the quality, and for a bad value our reason as the property `why`.
void add_quality(Metric& metric, const std::optional<BadReason>& bad);
/// Adds unit, limits, description and whether commands may write the tag, by the names under which
/// Ignition shows them.
void add_units(Metric& metric, const TagConfig& tag);

/// Returns the value of a command's metric as JSON, read as `type`. A value of another kind is
/// returned as it came: admission refuses it with the reason. nullopt: the metric has no value.
std::optional<std::string> json_of(const Metric& metric, Type type);

}  // namespace fxagent::sparkplug
