// When a link's channel is opened: at the start, after a loss and after each vain attempt. Many
// links that share a host, a switch or a power cut must not all knock at the same moment, so every
// time has its jitter. Pure: gives durations, the worker has the clock. Field thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <random>

namespace fxagent {

/// Limits of the times between attempts.
struct ReconnectRules {
  std::chrono::milliseconds first{500};  ///< after the first vain attempt; doubles with each
  std::chrono::milliseconds cap{30000};
  std::chrono::milliseconds after_loss{0};  ///< a channel that was open is tried again within
};

/// What a link does at its start.
struct LinkStart {
  std::chrono::nanoseconds open_after{0};
  std::chrono::nanoseconds poll_after{0};  ///< never before open_after
};

class ReconnectPolicy final {
 public:
  /// Links with different seeds have nothing in common, however near to each other these are.
  ReconnectPolicy(ReconnectRules rules, std::uint64_t seed);

  /// Somewhere in the time over which the starts of so many links are spread: 10 ms for each one's
  /// polls and 1 ms for its opening, polls within `period` in all.
  LinkStart start(std::size_t links, std::chrono::milliseconds period);
  /// How long to wait after an open channel was lost.
  std::chrono::nanoseconds after_loss();
  /// How long to wait after a vain attempt: doubling from `first`, or from `least` where that is
  /// more, to `cap`, a fifth more or less.
  std::chrono::nanoseconds after_failure(
      std::chrono::milliseconds least = std::chrono::milliseconds{0});
  /// The channel is open: the next failure is a first one.
  void opened() { delay_ = {}; }

 private:
  const ReconnectRules rules_;
  std::minstd_rand jitter_;
  std::chrono::milliseconds delay_{0};
};

}  // namespace fxagent
