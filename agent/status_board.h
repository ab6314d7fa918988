// Where the agent's status is published: the uplink puts a whole one there, any thread reads the
// newest. The uplink waits for no reader.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <utility>

#include "agent/messages.h"
#include "agent/status.h"

namespace fxagent {

class StatusBoard final {
 public:
  /// A status is published at most this often for readers.
  static constexpr std::chrono::seconds kFresh{1};

  /// `wake` lets the uplink see that a reader asks; any thread calls it, and it must not block for
  /// long.
  explicit StatusBoard(std::function<void()> wake) : wake_(std::move(wake)) {}

  /// The newest status. One that is older than kFresh at `now` is waited for, `patience` at the
  /// most: then it may be old, as its ts_ms says, or null, where there was none yet. Any thread but
  /// the uplink's.
  std::shared_ptr<const AgentStatus> read(SteadyTime now, std::chrono::milliseconds patience);
  /// From now on each status has the last values of what is reported from now on. They take
  /// memory, so nobody keeps them for no reader. Any thread.
  void want_values() { values_wanted_.store(true, std::memory_order_relaxed); }

  /// Uplink thread. Whether a reader waits for a status; whether one wants last values.
  bool is_asked() const { return asked_.load(std::memory_order_relaxed); }
  bool values_wanted() const { return values_wanted_.load(std::memory_order_relaxed); }
  /// Uplink thread. Takes the place of the one before, which its readers keep as it is.
  void publish(std::shared_ptr<const AgentStatus> status, SteadyTime now);

 private:
  const std::function<void()> wake_;
  std::atomic<bool> asked_ = false;
  std::atomic<bool> values_wanted_ = false;
  std::mutex mutex_;
  std::condition_variable published_;
  std::shared_ptr<const AgentStatus> newest_;
  SteadyTime newest_at_{};
};

}  // namespace fxagent
