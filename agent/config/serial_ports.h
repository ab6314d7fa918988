// Checks that this machine can open the serial ports of a config.
#pragma once

#include <string>
#include <vector>

#include "agent/config/config.h"

namespace fxagent {

/// Returns the ports that are missing, that this user may not open, or that another program uses.
/// An agent that runs the config file `file` does not count as another program. Pointers are those
/// of the file; lines are 0. Does not open the ports, since that would raise DTR.
std::vector<ConfigError> unavailable_ports(const Config& config, const std::string& file);

}  // namespace fxagent
