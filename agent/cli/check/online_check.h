// `fxagent check --online`: opens the links and the broker of a config and queries each device.
// Sends only reads.
#pragma once

#include <string>

#include "agent/config/model.h"

namespace fxagent {

/// Prints its findings on stdout. Skips a link that another process holds, and every link if an
/// agent on this machine runs this config. `path` is the file of `config`. Exit status:
/// exit_status() of online_report.h.
int run_online_check(const Config& config, const std::string& path, bool as_json);

}  // namespace fxagent
