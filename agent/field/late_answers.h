// What may still come to questions that nobody waits for any more. An answer without a number that
// is later than its question's end would pass for the next one's. Pure: the bus tells and asks.
// Field thread.
#pragma once

#include <chrono>
#include <cstdint>

#include "agent/messages.h"

namespace fxagent {

class LateAnswers final {
 public:
  /// What is owed. An ACK weighs more: it has no address, and a late one stays a worry until a read
  /// that was asked behind it has been answered.
  enum class Owed : std::uint8_t { none, data, acknowledgement };

  /// An answer may be later than `timeout_ms` of its device by as much again, but at least and at
  /// most by these.
  static constexpr std::chrono::milliseconds kLeast{100};
  static constexpr std::chrono::milliseconds kMost{5000};

  /// A question was given up at `ended` without a good answer. `timeout` is its device's.
  void given_up(Owed answer, SteadyTime ended, std::chrono::milliseconds timeout);
  /// Nothing older can be on its way any more.
  void settled() { owed_ = Owed::none; }
  Owed owed() const { return owed_; }
  /// What is still owed comes before this time or not at all.
  SteadyTime over_at() const { return over_at_; }

  /// Codec::probe() by this number: its answer is unlike that of any probe that may still be
  /// answered.
  std::uint32_t probe() const { return probe_; }
  /// It got no data: its answer may still come, and the next probe must be another one.
  void probe_failed() { ++probe_; }

 private:
  Owed owed_ = Owed::none;
  SteadyTime over_at_{};
  std::uint32_t probe_ = 0;
};

}  // namespace fxagent
