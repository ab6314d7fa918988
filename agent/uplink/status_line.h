// The agent's status in one line, for people: what `systemctl status` shows. Pure.
#pragma once

#include <string>

#include "agent/status.h"

namespace fxagent {

/// "links 1 of 2 up (line2 down), devices 3 of 4 online (press4 offline: link_down); broker
/// connected; 0 samples wait; 17 commands, 1 UNKNOWN_OUTCOME". What is wrong is named: of links and
/// devices the first three, why the broker is away and since when, why commands are not heard,
/// another agent with this id, a store that is in memory although the config has one, and a config
/// file that a reload has rejected. The status is one that the uplink has made: it has its config.
std::string status_line(const AgentStatus& status);

}  // namespace fxagent
