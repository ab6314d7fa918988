// Decides when the channel of a link is opened: at the start, after a loss and after each failed
// attempt. Links that share a host, a switch or a power cut must not all connect at the same
// moment, so every delay has jitter. Pure: returns durations; LinkState has the clock. Field
// thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <random>

namespace fxagent {

/// Limits of the delays between attempts.
struct ReconnectRules {
  std::chrono::milliseconds first{500};  ///< after the first failed attempt; doubles with each
  std::chrono::milliseconds cap{30000};
  std::chrono::milliseconds after_loss{0};  ///< longest delay after a loss
};

/// Delays of a link at its start.
struct LinkStart {
  std::chrono::nanoseconds open_after{0};
  std::chrono::nanoseconds poll_after{0};  ///< never before open_after
};

class ReconnectPolicy final {
 public:
  /// Links with different seeds get independent delays, however near to each other the seeds are.
  ReconnectPolicy(ReconnectRules rules, std::uint64_t seed);

  /// Returns random delays for the start of one of `links` links: at most 1 ms per other link until
  /// it opens, and at most 10 ms per other link, within `period`, until its polls begin.
  LinkStart start(std::size_t links, std::chrono::milliseconds period);
  /// Returns the delay after the loss of an open channel.
  std::chrono::nanoseconds after_loss();
  /// Returns the delay after a failed attempt. Doubles from `first`, or from `least` if that is
  /// more, up to `cap`, with a jitter of ±20 %.
  std::chrono::nanoseconds after_failure(
      std::chrono::milliseconds least = std::chrono::milliseconds{0});
  /// Records that the channel is open: the next failure counts as the first.
  void opened() { delay_ = {}; }

 private:
  const ReconnectRules rules_;
  std::minstd_rand jitter_;
  std::chrono::milliseconds delay_{0};
};

}  // namespace fxagent
