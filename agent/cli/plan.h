// `fxagent plan`: prints what plan_report.h knows of a config, for people or as JSON.
#pragma once

#include <string>
#include <vector>

#include "agent/config/config.h"

namespace fxagent {

/// Prints the plan to stdout; with `what_ifs` the plan before and after them. Exit status: 0, or 2
/// where a what-if is wrong, which stderr tells.
int run_plan(const Config& config, const std::vector<std::string>& what_ifs, bool as_json);

}  // namespace fxagent
