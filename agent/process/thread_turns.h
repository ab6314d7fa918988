// Whether threads of a library still get on: threads that never wait for long without being woken
// are looked at from outside, by how often the kernel has switched them. For a library that tells
// nothing of itself. Any one thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <string>
#include <utility>

namespace fxagent {

class ThreadTurns final {
 public:
  using Time = std::chrono::steady_clock::time_point;
  /// Between two looks that count. Who was not switched in so many of them in a row stands still:
  /// looks, not time alone, since a process that was stopped as a whole has missed both.
  static constexpr std::chrono::seconds kBetweenLooks{10};
  static constexpr int kLooks = 12;

  /// The threads of this process whose names begin with `prefix`. Each of them must wait for less
  /// than kBetweenLooks at a time wherever nobody else is to blame.
  explicit ThreadTurns(std::string prefix) : prefix_(std::move(prefix)) {}

  /// Looks, where a look is due. `excused`: they may wait for somebody else now, and begin anew.
  void look(Time now, bool excused);
  /// The name of a thread that stands still; empty: none does, or nobody can tell.
  const std::string& stands_still() const { return stands_still_; }

 private:
  struct Seen {
    std::uint64_t switches = 0;
    int looks = 0;  ///< in a row, with that many switches
  };

  std::string prefix_;
  std::map<int, Seen> seen_;  ///< by thread id
  Time look_at_{};
  std::string stands_still_;
};

}  // namespace fxagent
