// Counts durations in fixed buckets, for the histograms of metrics. An add() is a search among
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
  /// Upper bounds, inclusive. Durations above the last bound have a bucket of their own.
  static constexpr std::array<std::chrono::microseconds, 13> kBounds{
      std::chrono::microseconds(1'000),     std::chrono::microseconds(2'500),
      std::chrono::microseconds(5'000),     std::chrono::microseconds(10'000),
      std::chrono::microseconds(25'000),    std::chrono::microseconds(50'000),
      std::chrono::microseconds(100'000),   std::chrono::microseconds(250'000),
      std::chrono::microseconds(500'000),   std::chrono::microseconds(1'000'000),
      std::chrono::microseconds(2'500'000), std::chrono::microseconds(5'000'000),
      std::chrono::microseconds(10'000'000)};

  /// Counts a negative duration as 0.
  void add(std::chrono::nanoseconds duration) {
    const auto bound = std::ranges::lower_bound(kBounds, duration);
    ++counts_[static_cast<std::size_t>(bound - kBounds.begin())];
    sum_ += std::max(duration, std::chrono::nanoseconds(0));
  }

  /// Returns the count of each bucket: at or below its bound and above the previous one. The last
  /// bucket is above all bounds.
  const std::array<std::uint64_t, kBounds.size() + 1>& counts() const { return counts_; }
  std::chrono::nanoseconds sum() const { return sum_; }

 private:
  std::array<std::uint64_t, kBounds.size() + 1> counts_{};
  std::chrono::nanoseconds sum_{0};
};

}  // namespace fxagent
