// The last 256 measurements of one duration, for p50 and p99 in health. Field thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <vector>

#include "agent/handover/field_health.h"

namespace fxagent {

class PercentileWindow final {
 public:
  void add(std::chrono::nanoseconds duration) {
    const auto ms = std::chrono::duration<float, std::milli>(duration).count();
    if (window_.size() < kSize) {
      window_.push_back(ms);
    } else {
      window_[next_] = ms;
      next_ = (next_ + 1) % kSize;
    }
  }

  /// Returns the percentiles of the window in ms; 0 if it is empty.
  Percentiles percentiles() const {
    if (window_.empty()) return {};
    std::vector<float> sorted = window_;
    std::sort(sorted.begin(), sorted.end());
    const auto at = [&](std::size_t percent) {
      return static_cast<double>(
          sorted[std::min(sorted.size() - 1, sorted.size() * percent / 100)]);
    };
    return {at(50), at(99)};
  }

 private:
  static constexpr std::size_t kSize = 256;
  std::vector<float> window_;  ///< grows with use: an idle link costs nothing
  std::size_t next_ = 0;
};

}  // namespace fxagent
