// `fxagent acl`: the access rules that a mosquitto needs for the configured agent, and for people.
#pragma once

#include <string>
#include <vector>

#include "agent/config/config.h"

namespace fxagent {

struct AclQuestion {
  std::string agent;  ///< user name of the agent; empty: `mqtt.username` of the config
  std::vector<std::string> operators;
  std::vector<std::string> viewers;
};

/// Prints an acl_file to stdout. The agent may write what it publishes and read what it obeys, no
/// more; a viewer reads what the agent writes; an operator also writes commands. Exit status: 0, or
/// 2 where a user name cannot stand in such a file, which stderr tells.
int run_acl(const Config& config, const AclQuestion& what);

}  // namespace fxagent
