// Values of tags as Sparkplug metrics, and metrics of commands as JSON. Data types and their fields
// are those of Sparkplug 3.0, section 6.4.16. Pure functions, any thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "agent/config/model.h"
#include "agent/store/samples/sample_record.h"
#include "agent/telemetry.h"

namespace fxagent::sparkplug {

class Metric;

/// Numbers of the specification.
enum class Type : std::uint32_t {
  int16 = 2,
  int32 = 3,
  int64 = 4,
  uint16 = 6,
  uint32 = 7,
  uint64 = 8,
  real32 = 9,
  real64 = 10,
  boolean = 11,
  string = 12,
  int16_array = 23,
  int32_array = 24,
  int64_array = 25,
  uint16_array = 27,
  uint32_array = 28,
  uint64_array = 29,
  real32_array = 30,
  real64_array = 31,
  boolean_array = 32,
  string_array = 33
};

/// Quality codes of the specification.
enum class Quality : std::uint32_t { bad = 0, good = 192, stale = 500 };
/// `stale`: the device does not answer. `bad`: it answers, and not with a value.
Quality quality_of(const std::optional<BadReason>& bad);

/// Returns the data type of a tag's values in engineering units.
Type type_of(const Point& point);
/// Same for a value that was read.
Type type_of(const RecordedReading& reading);

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
