// Reads the limits of remote configs: `remote_config`, `remote_allow` and `remote_without_disk` of
// the section `agent`.
#pragma once

#include "agent/config/model.h"
#include "agent/config/read/reader.h"

namespace fxagent {

/// Reads the limits from the section `agent`. Reports faults to `reader`.
RemoteLimits read_remote_limits(ConfigReader& reader, const ConfigNode& agent);

/// Returns the limits as `check` prints them: "links, devices, commands.allow D300-D399".
std::string to_string(const RemoteLimits& limits);

}  // namespace fxagent
