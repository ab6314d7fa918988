// The agent's times of attempts to connect, written again from docs/operate/cluster.md: a part of a
// second after a loss, then doubled delays, each with up to a quarter more at random. Time is an
// argument.
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <random>

namespace fxfleet {

using Time = std::chrono::steady_clock::time_point;
using std::chrono::milliseconds;

class Reconnect final {
 public:
  /// `servers`: number of servers in the config.
  Reconnect(std::size_t servers, std::uint32_t seed) : servers_(servers), random_(seed) {}

  /// Index of the server to try next.
  std::size_t server() const { return (first_ + position_) % servers_; }
  /// Longest time that this attempt may take.
  milliseconds patience() const;
  void connected(Time now);
  // These return the time of the next attempt.
  /// An attempt has failed.
  Time after_failure(Time now);
  /// The connection was lost.
  Time after_loss(Time now);

 private:
  milliseconds delay(int failures, milliseconds longest);
  milliseconds up_to(milliseconds most);

  const std::size_t servers_;
  std::minstd_rand random_;
  std::size_t first_ = 0;     ///< server with which the round begins
  std::size_t position_ = 0;  ///< in the round
  int failed_rounds_ = 0;
  int thrown_rounds_ = 0;
  milliseconds last_pause_{};
  Time connected_at_{};
  std::optional<Time> last_up_;
};

}  // namespace fxfleet
