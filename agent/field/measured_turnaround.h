// How long one device takes to answer, beside the characters on the wire: the config's word at
// first, later what was measured. Pure. Field thread.
#pragma once

#include <chrono>
#include <cstdint>

namespace fxagent {

class MeasuredTurnaround final {
 public:
  explicit MeasuredTurnaround(std::chrono::nanoseconds assumed) : value_(assumed) {}

  /// The turnaround of one exchange that ended well.
  void add(std::chrono::nanoseconds measured) {
    sum_ += measured;
    ++count_;
  }
  /// To be called now and then: takes over the mean of what was added, once that is enough and
  /// differs so much that other plans may be better. True: value() is another one.
  bool review();
  std::chrono::nanoseconds value() const { return value_; }

 private:
  std::chrono::nanoseconds value_;
  std::chrono::nanoseconds sum_{0};
  std::uint32_t count_ = 0;
};

}  // namespace fxagent
