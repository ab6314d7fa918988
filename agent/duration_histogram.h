// Counts durations by fixed bounds, for the histograms of metrics. Adding one is a search among
// thirteen numbers and two additions. One thread.
#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>

namespace fxagent {

class DurationHistogram final {
 public:
  /// Upper bounds, each with what is equal to it. What is longer than the last has a count of its
  /// own.
  static constexpr std::array<std::chrono::microseconds, 13> kBounds{
      std::chrono::microseconds(1'000),     std::chrono::microseconds(2'500),
      std::chrono::microseconds(5'000),     std::chrono::microseconds(10'000),
      std::chrono::microseconds(25'000),    std::chrono::microseconds(50'000),
      std::chrono::microseconds(100'000),   std::chrono::microseconds(250'000),
      std::chrono::microseconds(500'000),   std::chrono::microseconds(1'000'000),
      std::chrono::microseconds(2'500'000), std::chrono::microseconds(5'000'000),
      std::chrono::microseconds(10'000'000)};

  /// A negative duration counts as none.
  void add(std::chrono::nanoseconds duration) {
    const auto bound = std::ranges::lower_bound(kBounds, duration);
    ++counts_[static_cast<std::size_t>(bound - kBounds.begin())];
    sum_ += std::max(duration, std::chrono::nanoseconds(0));
  }

  /// How many lie at or below each bound and above the one before; the last: above all bounds.
  const std::array<std::uint64_t, kBounds.size() + 1>& counts() const { return counts_; }
  std::chrono::nanoseconds sum() const { return sum_; }

 private:
  std::array<std::uint64_t, kBounds.size() + 1> counts_{};
  std::chrono::nanoseconds sum_{0};
};

}  // namespace fxagent
