// How long to wait before something is tried again: 1 s after the first failure, twice as much
// after each further one, and up to a quarter more by chance, so that a plant full of agents does
// not come at once.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <random>

namespace fxagent {

class JitteredBackoff final {
 public:
  explicit JitteredBackoff(std::uint32_t seed) : random_(seed) {}

  /// After the first failure `failures` is 0. At most `longest` and a quarter of it.
  std::chrono::milliseconds after(int failures,
                                  std::chrono::milliseconds longest = std::chrono::seconds(30)) {
    constexpr std::chrono::milliseconds kFirst{1000};
    const auto plain = std::min(longest, kFirst * (1 << std::clamp(failures, 0, 6)));
    std::uniform_int_distribution<std::int64_t> extra(0, plain.count() / 4);
    return plain + std::chrono::milliseconds(extra(random_));
  }

 private:
  std::minstd_rand random_;
};

}  // namespace fxagent
