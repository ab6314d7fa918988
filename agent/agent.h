// Composition root: builds the parts from a config, starts them, stops them in order.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "agent/config/model.h"
#include "agent/process/stop_watchdog.h"
#include "agent/remote/remote_config.h"

namespace fxagent {

/// Runs the agent with `config`, the result of start() of `remote`. Reads the file at `path` again
/// at each SIGHUP (blocked in all threads) until the watchdog receives a stop signal. Logs each
/// frame of the links in `traced` (indexes in Config::links). SIGUSR1 toggles this for all links:
/// off if any link is traced, else on. After the stop signal it stops polling, answers the waiting
/// commands, sends results and samples, and publishes the agent's state as offline. Then it
/// returns, unless the watchdog ends the process first. Throws an exception with the reason if the
/// machine lacks something that the agent needs to start.
void run_agent(Config config, const std::string& path, RemoteConfig& remote, StopWatchdog& watchdog,
               const std::vector<std::uint32_t>& traced = {});

}  // namespace fxagent
