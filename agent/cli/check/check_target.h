// `fxagent check --target`: what a broker other than mosquitto refuses in a config. The limits are
// in one table in check_target.cpp, with their sources. Pure.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "agent/config/config_error.h"
#include "agent/config/model.h"

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

}  // namespace fxagent
