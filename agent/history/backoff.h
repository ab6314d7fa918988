// Pauses between attempts, and the report of a silent subscription. Pure: time is an argument.
#pragma once

#include <algorithm>
#include <chrono>
#include <optional>

#include "agent/steady_time.h"

namespace fxagent::history {

/// A pause that doubles from `first` to `most`.
class Backoff final {
 public:
  Backoff(std::chrono::milliseconds first, std::chrono::milliseconds most)
      : first_(first), most_(most) {}

  std::chrono::milliseconds next() { return pause_ = std::clamp(pause_ * 2, first_, most_); }
  void reset() { pause_ = {}; }

 private:
  std::chrono::milliseconds first_;
  std::chrono::milliseconds most_;
  std::chrono::milliseconds pause_{0};
};

/// Pauses between connections to the broker. After a subscription of less than 10 s they grow from
/// 1 s to 60 s: two processes with one client id end each other's connection at once.
class BrokerBackoff final {
 public:
  void subscribed(SteadyTime now) {
    subscribed_at_ = now;
    attempts_.reset();
  }
  /// True if the last connection was subscribed, and for less than 10 s.
  bool is_short(SteadyTime now) const {
    return subscribed_at_ && now - *subscribed_at_ < std::chrono::seconds(10);
  }
  /// Returns the pause after a lost connection or a failed attempt.
  std::chrono::milliseconds next(SteadyTime now) {
    if (!subscribed_at_) return attempts_.next();
    const bool was_short = is_short(now);
    subscribed_at_.reset();
    if (was_short) return short_ones_.next();
    short_ones_.reset();
    return attempts_.next();
  }

 private:
  std::optional<SteadyTime> subscribed_at_;
  Backoff attempts_{std::chrono::milliseconds(100), std::chrono::seconds(5)};
  Backoff short_ones_{std::chrono::seconds(1), std::chrono::seconds(60)};
};

/// Detects that no message arrives within a minute of the first subscription.
class Silence final {
 public:
  void subscribed(SteadyTime now) {
    if (state_ == State::idle) {
      state_ = State::waits;
      end_ = now + std::chrono::minutes(1);
    }
  }
  void received() { state_ = State::done; }
  /// Returns true once.
  bool is_over(SteadyTime now) {
    if (state_ != State::waits || now < end_) return false;
    state_ = State::done;
    return true;
  }

 private:
  enum class State : unsigned char { idle, waits, done };

  State state_ = State::idle;
  SteadyTime end_{};
};

}  // namespace fxagent::history
