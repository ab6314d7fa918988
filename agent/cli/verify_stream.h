// `fxagent verify-stream`: subscribes to the data of the configured agent and checks that it is
// complete.
#pragma once

#include <chrono>
#include <string>

#include "agent/config/model.h"

namespace fxagent {

struct VerifyStream {
  std::chrono::seconds listen{60};
  /// Overrides the config's user and password, for brokers that do not let the agent read its own
  /// data; empty: the config's.
  std::string username;
  std::string password_file;
  std::string password_env;
  bool as_json = false;
};

/// Connects to the first server of the config that answers, under its own client id, and again
/// whenever the connection is lost. Prints its report to stdout after `listen`, or sooner on SIGINT
/// or SIGTERM. Exit status: 0 nothing is missing; 1 samples are missing or none arrived; 2 no
/// broker could be listened to, at the start or at the end (reason on stderr); 3 nothing is known
/// to be missing, but the broker kept no session during an interruption, and samples of that time
/// did not arrive.
int run_verify_stream(const Config& config, const VerifyStream& what);

}  // namespace fxagent
