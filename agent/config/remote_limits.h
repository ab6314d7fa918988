// Reads what may come over MQTT: `agent.remote_config`, `remote_allow`, `remote_without_disk`.
#pragma once

#include "agent/config/config.h"
#include "agent/config/reader.h"

namespace fxagent {

/// `agent` is the section of that name.
RemoteLimits read_remote_limits(ConfigReader& reader, const ConfigNode& agent);

/// For `check`: "links, devices, commands.allow D300-D399".
std::string to_string(const RemoteLimits& limits);

}  // namespace fxagent
