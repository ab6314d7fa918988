#include "agent/field/poll/measured_turnaround.h"

#include <algorithm>
#include <utility>

namespace fxagent {
namespace {

// Number of exchanges for a mean. A mean counts if it differs from the old one by this factor and
// by more than the scheduling noise of a busy machine.
constexpr std::uint32_t kEnough = 64;
constexpr double kOther = 1.5;
constexpr std::chrono::milliseconds kNoise{3};

}  // namespace

bool MeasuredTurnaround::review() {
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

}  // namespace fxagent
