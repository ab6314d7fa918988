// Delays between attempts: 1 s after the first failure, doubled after each further one, plus up to
// a quarter at random, so that the agents of a plant do not all reconnect at once.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <random>

namespace fxagent {

class JitteredBackoff final {
 public:
  explicit JitteredBackoff(std::uint32_t seed) : random_(seed) {}

  /// `failures` is 0 after the first failure. Returns at most `longest` and a quarter of it.
  std::chrono::milliseconds after(int failures,
                                  std::chrono::milliseconds longest = std::chrono::seconds(30)) {
    constexpr std::chrono::milliseconds kFirst{1000};
    const auto plain = std::min(longest, kFirst * (1 << std::clamp(failures, 0, 6)));
    std::uniform_int_distribution<std::int64_t> extra(0, plain.count() / 4);
    return plain + std::chrono::milliseconds(extra(random_));
  }

  /// Returns a random time from 0 to `longest`.
  std::chrono::milliseconds up_to(std::chrono::milliseconds longest) {
    std::uniform_int_distribution<std::int64_t> any(0, longest.count());
    return std::chrono::milliseconds(any(random_));
  }

 private:
  std::minstd_rand random_;
};

}  // namespace fxagent
