// Says in words what is wrong with the plant now, and what still works: the first thing on the
// page. Pure; any thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "agent/handover/status.h"

namespace fxagent {

enum class Severity : std::uint8_t { warn, bad };

/// One thing that is wrong.
struct Problem {
  Severity severity = Severity::warn;
  std::string place;          ///< "device press4", "link line1", "broker"; empty: the agent
  std::string text;           ///< one sentence: what is wrong
  std::string cure;           ///< what to check or to do
  std::int64_t since_ms = 0;  ///< 0: unknown
};

struct Verdict {
  std::vector<Problem> problems;  ///< the worst first, then the oldest
  std::string works;              ///< "3 of 4 devices answer; the broker is connected"
};

/// Returns the verdict on a status with its config. `dropped_ms` is when samples were last dropped;
/// it counts for an hour. 0: never.
Verdict verdict_of(const AgentStatus& status, std::int64_t dropped_ms = 0);

}  // namespace fxagent
