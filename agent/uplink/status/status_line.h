// The agent's status in one line for people, as `systemctl status` shows it. Pure.
#pragma once

#include <string>

#include "agent/handover/status.h"

namespace fxagent {

/// "links 1 of 2 up (line2 down), devices 3 of 4 online (press4 offline: link_down); broker
/// connected; 0 samples wait; 17 commands, 1 UNKNOWN_OUTCOME". Names what is wrong: the first three
/// links and devices, why and since when the broker is away, and why commands are not received.
/// Also reports another agent with this id, a store in memory although the config has one, and a
/// config file that a reload has rejected. `status` comes from the uplink, so that it has a config.
std::string status_line(const AgentStatus& status);

}  // namespace fxagent
