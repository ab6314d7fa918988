// `fxagent run`: loads the config and runs the agent until SIGTERM.
#pragma once

#include <string>
#include <vector>

namespace fxagent {

struct RunQuestion {
  std::string path;
  std::string log_level = "info";
  std::string log_format = "text";
  std::vector<std::string> traced;  ///< links by name
};

/// Exit status: 0 after a stop signal, 1 if the agent could not run, 2 if the config or a traced
/// link is wrong; the reason is in the log. Throws std::runtime_error if the process may not have
/// enough threads or memory. Call before any thread starts.
int run_until_stopped(const RunQuestion& what);

}  // namespace fxagent
