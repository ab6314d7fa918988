// The composition root: builds the rooms from a config, starts them, stops them in order.
#pragma once

#include <csignal>

#include "agent/config.h"

namespace fxagent {

/// Polls, publishes and obeys commands until one of `stop_signals` arrives, which the caller has
/// blocked before any thread was started. Then: polls stop, waiting commands are answered, results
/// and samples go out, the agent's state goes to offline. Returns after that.
void run_agent(const Config& config, const sigset_t& stop_signals);

}  // namespace fxagent
