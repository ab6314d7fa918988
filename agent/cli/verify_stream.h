// `fxagent verify-stream`: listens to what the configured agent publishes and says whether it is
// whole.
#pragma once

#include <chrono>
#include <string>

#include "agent/config/config.h"

namespace fxagent {

struct VerifyStream {
  std::chrono::seconds listen{60};
  /// In place of the config's user and password, where the broker does not let the agent read its
  /// own data; empty: the config's.
  std::string username;
  std::string password_file;
  std::string password_env;
  bool as_json = false;
};

/// Connects to the first server of the config that answers, under a client id of its own, and
/// prints its report to stdout after `listen`, or sooner on SIGINT or SIGTERM. Exit status: 0
/// nothing is missing, 1 something is or nothing came, 2 no broker, or it was lost, which stderr
/// tells.
int run_verify_stream(const Config& config, const VerifyStream& what);

}  // namespace fxagent
