// The composition root: builds the rooms from a config, starts them, stops them in order.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "agent/config/config.h"
#include "agent/process/stop_watchdog.h"
#include "agent/remote/remote_config.h"

namespace fxagent {

/// Polls, publishes and obeys commands by `config`, with which `remote` has begun. The file at
/// `path` is read again at each SIGHUP (blocked in all threads), until the watchdog has a stop
/// signal. Of the links `traced`, by index in Config::links, each frame is logged; SIGUSR1 switches
/// that for all links, off where one is traced, else on. After the stop signal: polls stop, waiting
/// commands are answered, results and samples go out, the agent's state goes to offline. Returns
/// after that, or the watchdog ends the process. Throws what says why, where the machine lacks what
/// the agent needs to begin.
void run_agent(Config config, const std::string& path, RemoteConfig& remote, StopWatchdog& watchdog,
               const std::vector<std::uint32_t>& traced = {});

}  // namespace fxagent
