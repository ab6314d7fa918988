// Time that one device takes to answer, without the characters on the wire: first as configured,
// later as measured. Pure. Field thread.
#pragma once

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
  bool review();
  std::chrono::nanoseconds value() const { return value_; }

 private:
  std::chrono::nanoseconds value_;
  std::chrono::nanoseconds sum_{0};
  std::uint32_t count_ = 0;
};

}  // namespace fxagent
