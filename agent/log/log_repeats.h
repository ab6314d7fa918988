// Which log lines are written: of equal ones the first few of a while; the rest is counted and
// reported in one line when the while is over. Pure: time is an argument. One thread at a time.
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
  /// So many texts are counted at a time; those beyond are written.
  static constexpr std::size_t kMostTexts = 256;

  struct Repeated {
    int level = 0;
    std::string text;
    std::uint64_t count = 0;  ///< that were not written
  };

  /// Whether this line is to be written; otherwise it was counted.
  bool take(Time now, int level, std::string_view text);
  /// Of the whiles that are over at `now`, all of them at Time::max(): what was counted in them.
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
