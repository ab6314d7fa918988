// Compares a running config with the next one for a reload: the links and devices to end and to
// begin, and the config in force afterwards. Links and devices that go on keep their index. Pure.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config/config_error.h"
#include "agent/config/model.h"

namespace fxagent {

/// Change from the config in force to the next one. End all old links and devices before you begin
/// the first new one: both may have the same name, index and serial port.
struct ConfigChange {
  /// The next config. A link or device keeps the index of its name; a new one takes the first
  /// vacant place or a place after the last. Devices that go on unchanged are shared with the
  /// running config, so references to them stay valid.
  Config config;
  // Indices in the running config, ascending.
  std::vector<std::uint32_t> links_end;
  /// Includes the devices of links that end.
  std::vector<std::uint32_t> devices_end;
  /// Names of the devices that `config` has no more.
  std::vector<std::string> devices_gone;
  // Indices in `config`, ascending. A changed link or device is in both lists.
  std::vector<std::uint32_t> links_begin;
  std::vector<std::uint32_t> devices_begin;
  /// Devices that go on and whose groups differ only in interval, publish or max_silent.
  std::vector<std::uint32_t> devices_adjusted;
  /// Links that go on with a different poll_share or listening.
  std::vector<std::uint32_t> links_adjusted;
  bool mqtt = false;    ///< reconnect to the broker with new settings
  bool remote = false;  ///< the limits of remote configs differ

  /// True if at most the text of the config differs.
  bool empty() const {
    return links_end.empty() && links_begin.empty() && devices_end.empty() &&
           devices_begin.empty() && devices_adjusted.empty() && links_adjusted.empty() && !mqtt &&
           !remote;
  }
};

/// Returns the change from `running` to `wanted`. Only `running` may have vacant places.
ConfigChange change_between(const Config& running, Config wanted);

/// Returns an error for each setting of `wanted` that needs a restart of the agent, such as its id,
/// its store or its brokers. The texts describe what is in force. The lines are those of `file`,
/// the text of the local file of `wanted`; empty: the errors have no lines.
std::vector<ConfigError> needs_restart(const Config& running, const Config& wanted,
                                       std::string_view file = {});

/// Returns the change for the log, with devices by name: "changed: 2 (press1 press2), new: 1
/// (oven), gone: 1 (saw), mqtt". Returns "nothing" if the change is empty().
std::string to_string(const ConfigChange& change, const Config& running);

}  // namespace fxagent
