// The silence of one polled device, the rests after failed attempts, and the counters of its polls.
// Pure: time is an argument. Field thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

#include "agent/steady_time.h"

namespace fxagent {

/// Limits of a Rest.
struct BackOff {
  std::chrono::milliseconds first{1000};
  std::chrono::milliseconds cap{30000};
};

/// Rest after a failed attempt. Doubles from BackOff::first to BackOff::cap with each one.
class Rest final {
 public:
  void begin(SteadyTime now, const BackOff& back_off) {
    delay_ = std::min(std::max(back_off.first, delay_ * 2), back_off.cap);
    until_ = now + delay_;
  }
  /// Ends it at `at`, if it lasts longer. The next one is longer all the same.
  void end(SteadyTime at) { until_ = std::min(until_, at); }
  /// Returns its end; a time that has passed if there is none.
  SteadyTime until() const { return until_; }

 private:
  std::chrono::milliseconds delay_{0};
  SteadyTime until_{};
};

/// One device of a line. While it is silent, its polls rest, longer after each failed attempt.
class PolledDevice final {
 public:
  struct Counters {
    std::uint64_t polls = 0;   ///< cycles begun
    std::uint64_t missed = 0;  ///< polls skipped because the line or the device was busy or silent
  };

  /// `unanswered_limit`: consecutive exchanges without an answer that make the device silent.
  PolledDevice(int unanswered_limit, BackOff back_off)
      : unanswered_limit_(unanswered_limit), back_off_(back_off) {}
  void set_back_off(BackOff back_off) { back_off_ = back_off; }

  void answered() {
    unanswered_ = 0;
    rest_ = {};
  }
  enum class AskedBy : std::uint8_t { poll, command };
  /// Counts one more exchange without an answer. True if the device is silent now: its polls rest
  /// until the back-off has passed. Commands begin a rest and never extend one: a stream of them
  /// would keep the polls from finding that the tags are bad.
  bool unanswered(SteadyTime now, AskedBy by = AskedBy::poll) {
    const bool was_silent = is_silent();
    ++unanswered_;
    if (is_silent() && !(was_silent && by == AskedBy::command)) rest_.begin(now, back_off_);
    return is_silent();
  }
  bool is_silent() const { return unanswered_ >= unanswered_limit_; }
  /// Returns the number of consecutive exchanges without an answer.
  int unanswered_in_a_row() const { return unanswered_; }
  SteadyTime rests_until() const { return rest_.until(); }
  const BackOff& back_off() const { return back_off_; }

  void cycle_begun() { ++counters_.polls; }
  void missed(std::uint64_t polls) { counters_.missed += polls; }
  const Counters& counters() const { return counters_; }

 private:
  int unanswered_limit_;
  BackOff back_off_;
  int unanswered_ = 0;
  Rest rest_;
  Counters counters_;
};

}  // namespace fxagent
