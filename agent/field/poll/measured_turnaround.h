// Time that one device takes to answer, without the characters on the wire: first as configured,
// later as measured. Pure. Field thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

namespace fxagent {

class MeasuredTurnaround final {
 public:
  explicit MeasuredTurnaround(std::chrono::nanoseconds assumed) : value_(assumed) {}

  /// Adds the turnaround of one exchange that ended well.
  void add(std::chrono::nanoseconds measured) {
    sum_ += measured;
    ++count_;
  }
  /// Call regularly. Adopts the mean of the added measurements if there are enough of them, and if
  /// it differs enough to change plans. True: value() has changed.
  bool review() {
    if (count_ < kEnough) return false;
    const std::chrono::nanoseconds mean = sum_ / count_;
    count_ = 0;
    sum_ = {};
    const auto [least, most] = std::minmax(mean, value_);
    if (most - least <= kNoise ||
        static_cast<double>(most.count()) <= static_cast<double>(least.count()) * kOther)
      return false;
    value_ = mean;
    return true;
  }
  std::chrono::nanoseconds value() const { return value_; }

 private:
  // Number of exchanges for a mean. A mean counts if it differs from the old one by this factor and
  // by more than the scheduling noise of a busy machine.
  static constexpr std::uint32_t kEnough = 64;
  static constexpr double kOther = 1.5;
  static constexpr std::chrono::milliseconds kNoise{3};

  std::chrono::nanoseconds value_;
  std::chrono::nanoseconds sum_{0};
  std::uint32_t count_ = 0;
};

}  // namespace fxagent
