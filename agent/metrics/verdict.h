// What /healthz and /readyz answer, and why. Any thread.
#pragma once

#include <chrono>
#include <string>

#include "agent/messages.h"
#include "agent/status.h"

namespace fxagent {

/// The uplink makes a status each time that it is asked, at the most so much later.
inline constexpr std::chrono::seconds kUplinkWithin{10};
/// The field tells its counters every 5 s.
inline constexpr std::chrono::seconds kFieldWithin{20};

struct Verdict {
  bool good = true;
  std::string json;  ///< `{"ok":false,"why":[…],…}`, one line
};

/// Whether the uplink's status is too old to be shown: its thread stands still.
bool is_stale(const AgentStatus* status, SteadyTime now);

/// Good: the field's thread and the uplink's went on lately. A PLC, a line or a broker that is away
/// changes nothing: a restart of the agent would not bring it back. `status` null: there is none
/// yet.
Verdict health_of(const AgentStatus* status, SteadyTime now);

/// Good: healthy, connected to a broker, commands are heard, and no other agent has the same id.
Verdict readiness_of(const AgentStatus* status, SteadyTime now);

}  // namespace fxagent
