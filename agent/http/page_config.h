// The config as the page needs it: links, devices, groups and tags, and the time that each group
// takes on its line. JSON without secrets. Pure; any thread.
#pragma once

#include <cstddef>
#include <string>

#include "agent/config/model.h"
#include "agent/handover/status.h"

namespace fxagent {

/// Returns /api/config: all that stays the same until the next reload. Links and devices stand at
/// their index in the config; a vacant place is null. With templates expanded.
std::string page_config(const AgentStatus& status);

/// Returns /api/plan: for each group on the link its line time per cycle and the number of
/// exchanges, as planned from the config. The time is null if the speed of the line is unknown.
std::string page_plan(const Config& config, std::size_t link);

}  // namespace fxagent
