// `fxagent check --target`: what a broker other than mosquitto refuses in a config. The limits are
// in one table in check_target.cpp, with their sources. Pure.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "agent/config/config_error.h"
#include "agent/config/json/tree.h"
#include "agent/config/model.h"
#include "agent/uplink/payload/payload.h"

namespace fxagent {

struct TargetFinding {
  /// `refused`: the broker rejects a connection, a topic or a message of this config. `warning`: it
  /// does so only in some cases, or behaves differently from the interface.
  enum class Severity : std::uint8_t { refused, warning };
  Severity severity = Severity::refused;
  ConfigError error;  ///< place, cause and cure
};

/// Returns an empty string if `target` is a target; otherwise why not.
std::string target_fault(std::string_view target);

/// Returns the name of the broker for people: "AWS IoT Core". `target` must be a target.
std::string_view broker_of(std::string_view target);

/// Compares a config with the limits of `target`, which must be a target. `text` is the text that
/// `config` was read from, for line numbers and pointers to devices. Lists at most 20 messages that
/// are too large.
std::vector<TargetFinding> target_findings(const Config& config, std::string_view text,
                                           std::string_view target);

// ---- parts, for tests

/// Places in a config file of findings that are made after reading it.
class ConfigPlaces {
 public:
  /// `text` is that of the config. It must outlive the object.
  explicit ConfigPlaces(std::string_view text)
      : tree_(ConfigTree::parse(text, ConfigTree::Folding::tags, {}, Comments::allowed)) {}

  /// Returns the line of the value at a JSON pointer, or of the nearest section around it if the
  /// value is absent. Returns 0 if the text is no config.
  int line(std::string_view pointer) const;

  /// Returns the pointer of a device, such as "/devices/3"; "/devices" if its entry makes several.
  std::string device(std::string_view name) const;

 private:
  const tl::expected<ConfigTree, ConfigError> tree_;  ///< error: the text is not JSON
};

/// Returns the bytes of the largest sample of a group on its history topic, where it is longest. A
/// sample is largest while its tags are bad, since it then has last values and times as well.
/// `group` is an index in `device.groups`.
std::size_t largest_history(SamplePayload& payload, const DeviceConfig& device, std::size_t group);

/// Returns the bytes of health after years of operation.
std::size_t largest_health(const Config& config);

}  // namespace fxagent
