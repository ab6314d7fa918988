// `fxagent plan`: prints the analysis of plan_report.h as text or JSON.
#pragma once

#include <string>
#include <vector>

#include "agent/config/model.h"

namespace fxagent {

struct PlanQuestion {
  std::vector<std::string> what_ifs;  ///< each "DEVICE FIRST..LAST@MS"
  bool as_json = false;
};

/// Prints the plan to stdout; with what-ifs, the plan before and after them. Exit status: 0, or 2
/// if a what-if is wrong (reason on stderr).
int run_plan(const Config& config, const PlanQuestion& question);

}  // namespace fxagent
