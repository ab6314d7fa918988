// Tracks answers that may still arrive after their requests were given up. A late answer without a
// number would pass for the answer to the next request. Pure: time is an argument. Field thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>

#include "agent/steady_time.h"

namespace fxagent {

class LateAnswers final {
 public:
  /// The kind of answer still owed. An ACK outweighs data: it has no address, so a late one may
  /// arrive until a read sent after it has been answered.
  enum class Owed : std::uint8_t { none, data, acknowledgement };

  /// A late answer may exceed its device's `timeout_ms` by as much again, within these limits.
  static constexpr std::chrono::milliseconds kLeast{100};
  static constexpr std::chrono::milliseconds kMost{5000};

  /// Records a request that was given up at `ended` without a good answer. `timeout` is its
  /// device's; `bytes` the length of its answer.
  void given_up(Owed answer, SteadyTime ended, std::chrono::milliseconds timeout,
                std::uint32_t bytes) {
    owed_ = std::max(owed_, answer);
    owed_bytes_ += bytes;
    over_at_ = std::max(over_at_, ended + std::clamp(timeout, kLeast, kMost));
  }
  /// Records that no older answer can be on its way any more.
  void settled() {
    owed_ = Owed::none;
    owed_bytes_ = received_ = 0;
  }
  Owed owed() const { return owed_; }
  /// Adds bytes received while an answer is owed. True if there are more of them than is owed.
  bool add_received(std::size_t bytes) { return (received_ += bytes) > owed_bytes_; }
  /// Returns the time after which no owed answer can come.
  SteadyTime over_at() const { return over_at_; }

  /// Returns the number for Codec::probe(): the answer differs from that of every probe that may
  /// still be answered.
  std::uint32_t probe() const { return probe_; }
  /// Records that the probe got no data. Its answer may still come, so the next probe must differ.
  void probe_failed() { ++probe_; }

 private:
  Owed owed_ = Owed::none;
  std::size_t owed_bytes_ = 0;
  std::size_t received_ = 0;
  SteadyTime over_at_{};
  std::uint32_t probe_ = 0;
};

}  // namespace fxagent
