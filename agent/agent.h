// The composition root: builds the rooms from a config, starts them, stops them in order.
#pragma once

#include <string>

#include "agent/config/config.h"
#include "agent/process/stop_watchdog.h"

namespace fxagent {

/// Polls, publishes and obeys commands by `config`, which was read from `path` and is read again at
/// each SIGHUP (blocked in all threads), until the watchdog has a stop signal. Then: polls stop,
/// waiting commands are answered, results and samples go out, the agent's state goes to offline.
/// Returns after that, or the watchdog ends the process. Throws what says why, where the machine
/// lacks what the agent needs to begin.
void run_agent(Config config, const std::string& path, StopWatchdog& watchdog);

}  // namespace fxagent
