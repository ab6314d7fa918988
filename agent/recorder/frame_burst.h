// Detects a burst of bad frames: a few are noise, many in a short time are a fault. Pure.
#pragma once

#include <chrono>
#include <cstdint>

#include "agent/steady_time.h"

namespace fxagent {

class FrameBurst final {
 public:
  static constexpr std::uint64_t kFrames = 5;
  static constexpr std::chrono::seconds kWithin{60};

  /// Takes the number of bad frames since the start. Returns true once for each kFrames of them
  /// that came within kWithin.
  bool add(std::uint64_t total, SteadyTime now) {
    if (total <= seen_) return false;
    if (counted_ == 0 || now - since_ > kWithin) {
      counted_ = 0;
      since_ = now;
    }
    counted_ += total - seen_;
    seen_ = total;
    if (counted_ < kFrames) return false;
    counted_ = 0;
    return true;
  }

 private:
  std::uint64_t seen_ = 0;
  std::uint64_t counted_ = 0;
  SteadyTime since_{};
};

}  // namespace fxagent
