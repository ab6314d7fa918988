// Limits equal log lines. In each period the first few are written; the rest is counted and
// reported in one line when the period is over. Pure: time is an argument. One thread at a time.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace fxagent::log {

class LogRepeats final {
 public:
  using Time = std::chrono::steady_clock::time_point;
  static constexpr std::chrono::seconds kWhile{10};
  static constexpr std::uint64_t kWritten = 5;
  /// Most texts counted at a time; lines beyond these are written.
  static constexpr std::size_t kMostTexts = 256;

  struct Repeated {
    int level = 0;
    std::string text;
    std::uint64_t count = 0;  ///< lines not written
  };

  /// True if this line is to be written; otherwise it is counted.
  bool take(Time now, int level, std::string_view text);
  /// Returns the counts of all periods that are over at `now`; at Time::max(), of all periods.
  std::vector<Repeated> over(Time now);

 private:
  struct Seen {
    Time until{};
    int level = 0;
    std::uint64_t count = 0;
  };
  std::map<std::string, Seen, std::less<>> seen_;
};

}  // namespace fxagent::log
