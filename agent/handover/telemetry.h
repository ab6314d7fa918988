// Samples and device states, which the field sends to the uplink. Plain data: no wires, no JSON, no
// MQTT.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/value/value.h"

namespace fxagent {

class Codec;

enum class BadReason : std::uint8_t { timeout, nak, bad_frame, link_down, unsupported, bad_value };
/// Returns the payload's word.
inline std::string_view to_string(BadReason reason) {
  constexpr auto kWords = std::to_array<std::string_view>(
      {"timeout", "nak", "bad_frame", "link_down", "unsupported", "bad_value"});
  static_assert(kWords.size() == static_cast<std::size_t>(BadReason::bad_value) + 1);
  return kWords[static_cast<std::size_t>(reason)];
}

/// Reading of one tag within one message. `value` holds the value just read when the tag is good,
/// or the last good value (if any) when it is bad.
struct TagReading {
  std::uint32_t tag = 0;          ///< index in DeviceConfig::tags
  std::optional<BadReason> bad;   ///< nullopt: good
  Value value;                    ///< empty if the tag was never read
  std::int64_t bad_since_ms = 0;  ///< bad only: when the tag turned bad
  std::int64_t last_ms = 0;       ///< bad only: when `value` was read; 0 if never
};

/// Sample of one group of one device, read in one cycle. A partial sample holds one tag after a
/// write.
struct Telemetry {
  std::uint32_t device = 0;  ///< index in Config::devices
  std::uint32_t group = 0;
  std::uint64_t seq = 0;  ///< per device, assigned when the sample leaves the field
  std::int64_t ts_ms = 0;
  std::optional<double> span_ms;  ///< first to last reply; set if more than one exchange was needed
  bool partial = false;           ///< holds only the tag that a command has just written
  bool written = false;           ///< partial only: the value was written and not read back
  std::vector<TagReading> readings;
};

struct DeviceStatus {
  /// yielded: the link's port is free for another program, on command.
  enum class State : std::uint8_t { offline, yielded, degraded, online };
  std::uint32_t device = 0;
  State state = State::offline;
  std::int64_t since_ms = 0;
  std::string reason;       ///< empty: none
  std::string reason_text;  ///< human-readable `reason`: what to check; empty: no text
  std::string model;        ///< empty: unknown
  /// The model in the config if the PLC is a different one; else empty.
  std::string model_configured{};
  std::optional<bool> run;
  /// Codec that interprets the device's addresses: the config's, or the one for the detected model.
  /// Null: unchanged. Both threads read it; neither modifies it.
  std::shared_ptr<const Codec> codec{};
  /// Codec for the model that the PLC reports, if `codec` is for another model; else null.
  std::shared_ptr<const Codec> codec_of_plc{};

  friend bool operator==(const DeviceStatus&, const DeviceStatus&) = default;
  /// True if the device answers, at least to a part of what is read.
  bool is_alive() const { return state >= State::degraded; }
};
inline std::string_view to_string(DeviceStatus::State state) {
  constexpr auto kWords =
      std::to_array<std::string_view>({"offline", "yielded", "degraded", "online"});
  static_assert(kWords.size() == static_cast<std::size_t>(DeviceStatus::State::online) + 1);
  return kWords[static_cast<std::size_t>(state)];
}

}  // namespace fxagent
