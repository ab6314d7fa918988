// The trial of a remote config: it is good once there is a connection to the broker at the end
// of it, and it is given up where the broker was away for so long in one piece. Pure.
#pragma once

#include <chrono>
#include <optional>

#include "agent/messages.h"

namespace fxagent {

class Trial {
 public:
  enum class Verdict { pending, good, lost };

  /// Not connected: the broker is away since the beginning.
  Trial(std::chrono::milliseconds length, SteadyTime began, bool is_connected)
      : length_(length), began_(began) {
    if (!is_connected) away_since_ = began;
  }

  /// The connection was made or lost at `now`. One that is lost again is away from then on.
  void connection(bool is_connected, SteadyTime now) {
    if (is_connected)
      away_since_.reset();
    else if (!away_since_)
      away_since_ = now;
  }

  Verdict verdict(SteadyTime now) const {
    if (now < decided_at()) return Verdict::pending;
    return away_since_ ? Verdict::lost : Verdict::good;
  }

  /// When there is a verdict, unless the connection changes before.
  SteadyTime decided_at() const { return away_since_.value_or(began_) + length_; }

 private:
  const std::chrono::milliseconds length_;
  const SteadyTime began_;
  std::optional<SteadyTime> away_since_;
};

}  // namespace fxagent
