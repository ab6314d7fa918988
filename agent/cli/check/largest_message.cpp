#include "agent/cli/check/largest_message.h"

#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <utility>

#include "agent/handover/status.h"
#include "agent/uplink/payload/json_payload.h"
#include "protocol/value/point.h"
#include "protocol/value/raw.h"

namespace fxagent {
namespace {

/// Returns a value of the point that takes about as many bytes in JSON as any.
Value longest_value(const Point& point) {
  Scalar longest;
  switch (point.type) {
    case DataType::boolean:
      longest = false;
      break;
    case DataType::string:  // memory that is no text: JSON escapes each character
      longest = std::string(point.length, '\x01');
      break;
    case DataType::int64:
    case DataType::uint64:
      longest = BigInteger{"-9223372036854775808"};
      break;
    case DataType::float32:  // written with the digits of a float32, if it has no scale
      longest = point.scaled() ? std::numeric_limits<double>::lowest()
                               : double{-std::numeric_limits<float>::min()};
      break;
    case DataType::float64:
      longest = std::numeric_limits<double>::lowest();
      break;
    default: {
      const bool is_wide = bits_of_type(point.type) == 32;
      const double raw = is_wide ? std::numeric_limits<std::int32_t>::min() : -32768;
      longest = scaled_real(point, raw).value_or(Scalar(raw));
    }
  }
  if (!point.is_array) return Value(std::move(longest));
  return Value::array(Scalars(point.count, longest));
}

}  // namespace

std::size_t largest_history(SamplePayload& payload, const DeviceConfig& device, std::size_t group) {
  constexpr std::int64_t kTime = 1'790'000'000'000;
  SampleRecord sample;
  sample.ts_ms = kTime;
  sample.seq = kTime;
  sample.boot = "00000000";
  sample.meta = "0000000000000000";
  sample.span_ms = 1234.5;
  for (const TagConfig& tag : device.tags) {
    if (tag.group != group) continue;
    sample.readings.push_back({.name = tag.name,
                               .type = tag.point.type,
                               .scaled = tag.point.scaled(),
                               .bad = BadReason::unsupported,
                               .value = longest_value(tag.point),
                               .bad_since_ms = kTime,
                               .last_ms = kTime});
  }
  const auto message = payload.begin_history(/*max_bytes=*/0);
  message->add(sample);
  return message->take().size();
}

std::size_t largest_health(const Config& config) {
  constexpr std::uint64_t kCount = 9'999'999'999;
  constexpr Percentiles kLate{.p50 = 1234.5, .p99 = 1234.5};
  LinkHealth link;
  link.exchanges = link.timeouts = link.naks = link.bad_frames = kCount;
  link.unexpected_bytes = link.doubts = kCount;
  link.turnaround_ms = kLate;
  DeviceHealth device;
  device.polls = device.missed = kCount;
  device.late_ms = kLate;
  FieldHealth field;
  field.links.assign(config.links.size(), link);
  field.devices.assign(config.devices.size(), device);
  AgentStatus status;
  status.field = std::make_shared<const FieldHealth>(std::move(field));
  return json::health(status, config).size();
}

}  // namespace fxagent
