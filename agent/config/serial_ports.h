// Whether the serial ports of a config can be had on this machine.
#pragma once

#include <string>
#include <vector>

#include "agent/config/config.h"

namespace fxagent {

/// Ports that are not there, that this user may not open or that another program has. An agent that
/// runs `file`, that of the config, is no other program. Pointers are those of the file; lines are
/// 0. Opens none of them: that would raise DTR.
std::vector<ConfigError> unavailable_ports(const Config& config, const std::string& file);

}  // namespace fxagent
