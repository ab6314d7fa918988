#include "agent/field/link/reconnect_policy.h"

#include <algorithm>

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr milliseconds kPollsOfOneLink{10};
constexpr milliseconds kOpeningOfOneLink{1};
constexpr double kJitter = 0.2;

nanoseconds part(nanoseconds whole, double share) {
  return nanoseconds(static_cast<std::int64_t>(static_cast<double>(whole.count()) * share));
}

}  // namespace

ReconnectPolicy::ReconnectPolicy(ReconnectRules rules, std::uint64_t seed) : rules_(rules) {
  // Without this, the first values of the generator are near its seed.
  std::seed_seq mixed{seed & 0xFFFFFFFFU, seed >> 32};
  jitter_.seed(mixed);
}

LinkStart ReconnectPolicy::start(std::size_t links, milliseconds period) {
  // A single link begins at once.
  const auto others = static_cast<std::int64_t>(links > 0 ? links - 1 : 0);
  const nanoseconds polls = std::min<nanoseconds>(kPollsOfOneLink * others, period);
  const nanoseconds openings = std::min<nanoseconds>(kOpeningOfOneLink * others, polls);
  const double place = std::uniform_real_distribution<double>(0.0, 1.0)(jitter_);
  return {part(openings, place), part(polls, place)};
}

nanoseconds ReconnectPolicy::after_loss() {
  return part(rules_.after_loss, std::uniform_real_distribution<double>(0.0, 1.0)(jitter_));
}

nanoseconds ReconnectPolicy::after_failure(milliseconds least) {
  delay_ = std::clamp(std::max(delay_ * 2, least), rules_.first, rules_.cap);
  return part(delay_,
              std::uniform_real_distribution<double>(1.0 - kJitter, 1.0 + kJitter)(jitter_));
}

}  // namespace fxagent
