// Answers of /healthz and /readyz, with the reasons. Any thread.
#pragma once

#include <chrono>
#include <string>

#include "agent/handover/status.h"
#include "agent/steady_time.h"

namespace fxagent {

/// The uplink makes a status on request. It counts as hanging if the newest one is older than this.
inline constexpr std::chrono::seconds kUplinkWithin{10};
/// The field reports its counters every 5 s. It counts as hanging after this time without a report.
inline constexpr std::chrono::seconds kFieldWithin{20};

struct Probe {
  bool good = true;
  std::string json;  ///< `{"ok":false,"why":[…],…}`, one line
};

/// True if there is no status, or it is too old to show: then the uplink's thread hangs.
bool is_stale(const AgentStatus* status, SteadyTime now);

/// Good if the threads of field and uplink made progress lately. An unreachable PLC, line or broker
/// changes nothing: a restart of the agent would not help. `status` null: there is none yet.
Probe health_of(const AgentStatus* status, SteadyTime now);

/// Good if healthy, connected to a broker that refuses nothing, subscribed to commands, and no
/// other agent has our id.
Probe readiness_of(const AgentStatus* status, SteadyTime now);

}  // namespace fxagent
