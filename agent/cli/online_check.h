// `fxagent check --online`: opens the links and the broker of a config and asks each device, reads
// only.
#pragma once

#include <string>

#include "agent/config/config.h"

namespace fxagent {

/// Prints what it found on stdout. A link that another process has is left alone, and so are all
/// links when an agent on this machine runs this config. `path` is the file of `config`. Exit
/// status: exit_status() of online_report.h.
int run_online_check(const Config& config, const std::string& path, bool as_json);

}  // namespace fxagent
