// Tracks whether the answers on one wire can be trusted. Unexpected bytes may be a second answer to
// a request, or another master's. The next answer may then be foreign too, and a value or an ACK
// would be wrong with good quality. The bus is doubted from the first such bytes until several
// consecutive exchanges were clean. Pure: time is an argument. Field thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

#include "agent/steady_time.h"

namespace fxagent {

class BusDoubt final {
 public:
  /// Consecutive clean exchanges that end a doubt. A doubt that begins within kRelapse of the end
  /// of the last one needs twice as many as that, at most kMostExchanges.
  static constexpr std::uint32_t kCleanExchanges = 3;
  static constexpr std::uint32_t kMostExchanges = 12;
  static constexpr std::chrono::seconds kRelapse{60};

  /// Records unexpected bytes that may pass for an answer.
  void found_foreign(SteadyTime now) {
    ++findings_;
    was_out_of_step(now);
    if (!is_doubted()) {
      const bool relapse = doubts_ > 0 && now - ended_ < kRelapse;
      wanted_ = relapse ? std::min(wanted_ * 2, kMostExchanges) : kCleanExchanges;
      ++doubts_;
    }
    exchanges_to_go_ = wanted_;
  }
  /// Records a frame in place of an answer, or more bytes than the late answer that was owed. The
  /// bus puts itself in order after either, so this makes it wary and not doubted.
  void was_out_of_step(SteadyTime now) { wary_until_ = now + kRelapse; }
  /// Records an answered request with silence before it and after its answer, each as long as the
  /// slowest answer may take.
  void exchange_was_clean(SteadyTime now) {
    if (!is_doubted()) return;
    --exchanges_to_go_;
    if (!is_doubted()) ended_ = now;
  }
  /// Records a request that was not answered cleanly. Silence does not count: a device that is
  /// switched off must not keep its whole line in doubt.
  void exchange_was_unclear() {
    if (is_doubted()) exchanges_to_go_ = wanted_;
  }

  bool is_doubted() const { return exchanges_to_go_ > 0; }
  /// True if foreign bytes were found, or the bus was out of step, within the last kRelapse. The
  /// next answer may be foreign too: every read should be sent twice.
  bool is_wary(SteadyTime now) const { return now < wary_until_; }
  /// Returns how often foreign bytes were found. After a change of this number, an answer may
  /// belong to an earlier request.
  std::uint64_t findings() const { return findings_; }
  /// Returns how often the bus became doubted.
  std::uint64_t doubts() const { return doubts_; }

 private:
  std::uint64_t findings_ = 0;
  std::uint64_t doubts_ = 0;
  std::uint32_t exchanges_to_go_ = 0;
  std::uint32_t wanted_ = kCleanExchanges;
  SteadyTime wary_until_{};
  SteadyTime ended_{};  ///< end of the last doubt
};

}  // namespace fxagent
