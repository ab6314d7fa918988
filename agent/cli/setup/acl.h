// `fxagent acl`: the access rules that mosquitto needs for the configured agent and for people.
#pragma once

#include <string>
#include <tl/expected.hpp>
#include <vector>

#include "agent/config/model.h"

namespace fxagent {

struct AclQuestion {
  std::string agent;  ///< user name of the agent; empty: `mqtt.username` of the config
  std::vector<std::string> operators;
  std::vector<std::string> viewers;
  std::vector<std::string> engineers{};
};

/// Returns an acl_file. The agent may write what it publishes and read what it acts on, nothing
/// else. A viewer reads what the agent writes. An operator also writes commands; an engineer also
/// writes configs, if the config allows remote configs. The error lists each user name that an
/// acl_file cannot hold or that has two roles.
tl::expected<std::string, std::string> acl_text(const Config& config, const AclQuestion& what);

/// Prints the acl_file. Exit status: 0, or 2 with the errors on stderr.
int run_acl(const Config& config, const AclQuestion& what);

}  // namespace fxagent
