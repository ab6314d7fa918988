// Trial of a remote config. The config is good if the agent is connected to the broker at the end
// of the trial. It is lost if the broker is away for the length of a trial without a break. Pure.
#pragma once

#include <chrono>
#include <optional>

#include "agent/steady_time.h"

namespace fxagent {

class Trial {
 public:
  enum class Outcome { pending, good, lost };

  /// If not connected, the broker counts as away since `began`.
  Trial(std::chrono::milliseconds length, SteadyTime began, bool is_connected)
      : length_(length), began_(began) {
    if (!is_connected) away_since_ = began;
  }

  /// Call when the connection was made or lost at `now`. A repeated loss does not restart the time
  /// that the broker is away.
  void connection(bool is_connected, SteadyTime now) {
    if (is_connected)
      away_since_.reset();
    else if (!away_since_)
      away_since_ = now;
  }

  Outcome outcome(SteadyTime now) const {
    if (now < decided_at()) return Outcome::pending;
    return away_since_ ? Outcome::lost : Outcome::good;
  }

  /// Returns the time of the outcome, unless the connection changes before.
  SteadyTime decided_at() const { return away_since_.value_or(began_) + length_; }

 private:
  const std::chrono::milliseconds length_;
  const SteadyTime began_;
  std::optional<SteadyTime> away_since_;
};

}  // namespace fxagent
