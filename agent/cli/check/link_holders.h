// Processes that hold the links of a config, for the programs that open links beside a running
// agent: check --online, doctor, read, write, force-on, force-off.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "agent/cli/check/online_report.h"
#include "agent/config/model.h"

namespace fxagent {

/// Returns "/dev/ttyUSB0", "192.0.2.7:502" or "udp 192.0.2.7:5007".
std::string place_of(const LinkConfig& link);

/// Returns the holder of each link, indexed as Config::links; nullopt if the link is free. `path`
/// is the file of the config. The holder of a serial port is the process that has it open or
/// locked. An agent on this machine that runs this file holds every other link; one that runs
/// another file holds those of the same host and port. A link that it has freed by the command
/// `yield` is free.
std::vector<std::optional<OnlineHolder>> link_holders(const Config& config,
                                                      const std::string& path);

}  // namespace fxagent
