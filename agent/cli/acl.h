// `fxagent acl`: the access rules that a mosquitto needs for the configured agent, and for people.
#pragma once

#include <string>
#include <tl/expected.hpp>
#include <vector>

#include "agent/config/config.h"

namespace fxagent {

struct AclQuestion {
  std::string agent;  ///< user name of the agent; empty: `mqtt.username` of the config
  std::vector<std::string> operators;
  std::vector<std::string> viewers;
  std::vector<std::string> engineers{};
};

/// An acl_file. The agent may write what it publishes and read what it obeys, no
/// more; a viewer reads what the agent writes; an operator also writes commands, and an engineer
/// configs, where the config lets them come. The error names a user that cannot stand in such a
/// file.
tl::expected<std::string, std::string> acl_text(const Config& config, const AclQuestion& what);

/// Prints it. Exit status: 0, or 2 where there is an error, which stderr tells.
int run_acl(const Config& config, const AclQuestion& what);

}  // namespace fxagent
