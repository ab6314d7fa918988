// Publishes the agent's status: the uplink stores complete snapshots, any thread reads the newest.
// The uplink never waits for a reader.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <utility>

#include "agent/handover/status.h"
#include "agent/steady_time.h"

namespace fxagent {

class StatusBoard final {
 public:
  /// Minimum interval between two statuses published for readers.
  static constexpr std::chrono::seconds kFresh{1};

  /// `wake` makes the uplink notice that a reader is waiting. Any thread may call it; it must not
  /// block for long.
  explicit StatusBoard(std::function<void()> wake) : wake_(std::move(wake)) {}

  /// Returns the newest status. If that is older than kFresh at `now`, waits up to `patience` for a
  /// new one. After that the result may be old (see its ts_ms), or null if no status exists yet.
  /// Any thread except the uplink's.
  std::shared_ptr<const AgentStatus> read(SteadyTime now, std::chrono::milliseconds patience) {
    std::unique_lock lock(mutex_);
    if (newest_ && now - newest_at_ < kFresh) return newest_;
    const auto old = newest_;
    if (!asked_.exchange(true)) {
      lock.unlock();
      wake_();
      lock.lock();
    }
    published_.wait_for(lock, patience, [&] { return newest_ != old; });
    return newest_;
  }
  /// Makes every later status include the last values reported after this call. They take memory,
  /// so they are kept only once a reader wants them. Any thread.
  void want_values() { values_wanted_.store(true, std::memory_order_relaxed); }

  /// True if a reader waits for a status, or wants last values. Uplink thread.
  bool is_asked() const { return asked_.load(std::memory_order_relaxed); }
  bool values_wanted() const { return values_wanted_.load(std::memory_order_relaxed); }
  /// Replaces the current status; readers keep the one they hold. Uplink thread.
  void publish(std::shared_ptr<const AgentStatus> status, SteadyTime now) {
    {
      const std::lock_guard lock(mutex_);
      newest_.swap(status);
      newest_at_ = now;
      asked_ = false;
    }
    published_.notify_all();
  }  // frees the previous status here, outside of the lock

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
