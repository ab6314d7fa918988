// What a reload has to do: which links and devices of a running config end, which begin, and the
// config that is in force afterwards, in which nothing that goes on has another index. Pure.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "agent/config/config.h"

namespace fxagent {

/// From the config that is in force to the next one. What ends is over before the first of those
/// that begin does: they may have the same name, the same index, and the same port of the machine.
struct ConfigChange {
  /// The next one. A link or device has the place that its name had; a new one takes the first
  /// vacant place, or one behind the last. Devices that go on are shared with the running config,
  /// and what refers to one of them stays good.
  Config config;
  // Indices in the running config, in rising order.
  std::vector<std::uint32_t> links_end;
  /// Those of links that end among them.
  std::vector<std::uint32_t> devices_end;
  // Indices in `config`, in rising order. What is there under both words was changed.
  std::vector<std::uint32_t> links_begin;
  std::vector<std::uint32_t> devices_begin;
  /// Links that go on with another poll_share or listening.
  std::vector<std::uint32_t> links_adjusted;
  bool mqtt = false;    ///< the connection to the broker is to be made anew
  bool remote = false;  ///< something else can be set remotely

  /// Nothing but the text may differ.
  bool empty() const {
    return links_end.empty() && links_begin.empty() && devices_end.empty() &&
           devices_begin.empty() && links_adjusted.empty() && !mqtt && !remote;
  }
};

/// `running` has vacant places, `wanted` has none.
ConfigChange change_between(const Config& running, Config wanted);

/// The keys of `wanted` that a running agent cannot take over: its identity and its store. Each
/// error says what is in force. Empty: there is none.
std::vector<ConfigError> needs_restart(const Config& running, const Config& wanted);

/// "changed: 2 (press1 press2), new: 1 (oven), gone: 1 (saw), mqtt": devices by name, for the log.
/// "nothing" where the change is empty().
std::string to_string(const ConfigChange& change, const Config& running);

}  // namespace fxagent
