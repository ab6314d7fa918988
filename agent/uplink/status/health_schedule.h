// The times at which health is published: each minute, after each connect and when something has
// changed, with current counters if the field answers within 1 s. Uplink thread. Time is an
// argument.
#pragma once

#include <functional>
#include <optional>

#include "agent/steady_time.h"
#include "agent/uplink/retained/retained_state.h"
#include "agent/uplink/status/status_source.h"

namespace fxagent {

class HealthSchedule final {
 public:
  /// All references outlive the object. `ask_counters` makes the field send its counters; empty:
  /// health never waits for them.
  HealthSchedule(StatusSource& status, RetainedState& retained, std::function<void()> ask_counters);

  /// Call at the agent's start.
  void start(SteadyTime now);
  /// Publishes health as soon as the field's counters have come or are overdue. Call only while
  /// connected.
  void request(SteadyTime now);
  /// The field's counters have come.
  void counted();
  void connection_ended() { counters_by_.reset(); }
  /// Publishes the status that is due, to the board and as health.
  void report(bool is_connected, SteadyTime now);
  /// Returns the time by which report() must run again.
  SteadyTime next_wake() const;

 private:
  StatusSource& status_;
  RetainedState& retained_;
  const std::function<void()> ask_counters_;
  SteadyTime next_tick_{};
  /// Set when the field's counters were requested: health waits for them until then.
  std::optional<SteadyTime> counters_by_;
};

}  // namespace fxagent
