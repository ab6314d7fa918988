// One device of a line for the poll scheduler. While the device is silent, its polls rest, longer
// after each failed attempt. Pure: time is an argument, no I/O. Field thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

#include "agent/steady_time.h"

namespace fxagent {

/// Rest of a silent device. Doubles from `first` to `cap` with each failed attempt.
struct BackOff {
  std::chrono::milliseconds first{1000};
  std::chrono::milliseconds cap{30000};
};

class PolledDevice final {
 public:
  struct Counters {
    std::uint64_t polls = 0;   ///< cycles begun
    std::uint64_t missed = 0;  ///< polls skipped because the line or the device was busy or silent
  };

  /// `unanswered_limit`: number of consecutive exchanges without an answer that makes the device
  /// silent.
  PolledDevice(int unanswered_limit, BackOff back_off)
      : unanswered_limit_(unanswered_limit), back_off_(back_off) {}
  void set_back_off(BackOff back_off) { back_off_ = back_off; }

  void answered() {
    unanswered_ = 0;
    silent_ = false;
    delay_ = {};
    rests_until_ = {};
  }
  enum class AskedBy : std::uint8_t { poll, command };
  /// Counts one more exchange without an answer. True if the device is silent now: its polls rest
  /// until the back-off has passed. Commands begin a rest and never extend one: a stream of them
  /// would keep the polls from finding that the tags are bad.
  bool unanswered(SteadyTime now, AskedBy by = AskedBy::poll) {
    ++unanswered_;
    if (unanswered_ < unanswered_limit_) return false;
    if (silent_ && by == AskedBy::command) return true;
    silent_ = true;
    delay_ = std::min(std::max(back_off_.first, delay_ * 2), back_off_.cap);
    rests_until_ = now + delay_;
    return true;
  }
  bool is_silent() const { return silent_; }
  SteadyTime rests_until() const { return rests_until_; }

  void cycle_begun() { ++counters_.polls; }
  void missed(std::uint64_t polls) { counters_.missed += polls; }
  const Counters& counters() const { return counters_; }

 private:
  int unanswered_limit_;
  BackOff back_off_;
  int unanswered_ = 0;
  bool silent_ = false;
  std::chrono::milliseconds delay_{0};
  SteadyTime rests_until_{};
  Counters counters_;
};

}  // namespace fxagent
