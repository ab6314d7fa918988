// Detects hanging threads of a library that reports nothing about itself. A thread hangs if the
// kernel has not switched it for 2 min. Only for threads that never wait long. Any one thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <string>
#include <utility>

namespace fxagent {

class ThreadProgress final {
 public:
  using Time = std::chrono::steady_clock::time_point;
  /// Interval of checks. A thread that was not switched in kChecks checks in a row hangs. Counts
  /// checks, not time: a process that was stopped as a whole has missed the checks, too.
  static constexpr std::chrono::seconds kBetweenChecks{10};
  static constexpr int kChecks = 12;

  /// Checks the threads of this process whose names begin with `prefix`. Each of them must wait for
  /// less than kBetweenChecks at a time, unless `excused`. `part`: the part of the agent that hangs
  /// with them, for the log.
  ThreadProgress(std::string prefix, std::string part)
      : prefix_(std::move(prefix)), part_(std::move(part)) {}

  /// Checks the threads if a check is due. `excused`: they may be waiting for something else now,
  /// and their counts begin again. Returns true while none hangs; logs the first that does.
  bool check(Time now, bool excused);
  /// The name of a thread that hangs; empty: none does, or it is not known.
  const std::string& hanging_thread() const { return hanging_thread_; }

 private:
  struct Seen {
    std::uint64_t switches = 0;
    int checks = 0;  ///< checks in a row with this number
  };

  std::string prefix_;
  std::string part_;
  std::map<std::string, Seen> seen_;  ///< by thread id
  Time check_at_{};
  std::string hanging_thread_;
};

}  // namespace fxagent
