// The one shared object between the field thread and the uplink thread. Any thread.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <vector>

#include "agent/messages.h"

namespace fxagent {

class Outbox final {
 public:
  /// What one take() hands over, each list in the order it was pushed.
  struct Batch {
    std::vector<CommandResult> results;
    std::vector<DeviceStatus> states;
    std::vector<Telemetry> telemetry;
    std::optional<FieldHealth> health;  ///< the newest only
    std::map<std::uint32_t, std::uint64_t>
        dropped;  ///< telemetry dropped since the last take, by device
    /// Telemetry pushed since the outbox was made, dropped ones included. So after a take it is the
    /// number of samples that the uplink must account for.
    std::uint64_t pushed = 0;
    /// The same count at the moment `health` was pushed: what the field's own counters must agree
    /// with.
    std::uint64_t pushed_at_health = 0;
    std::vector<std::function<void(SteadyTime now)>> calls;  ///< once the rest is taken in
  };

  /// Holds at most `max_telemetry` messages; the oldest goes first and is counted.
  explicit Outbox(std::size_t max_telemetry) : max_telemetry_(max_telemetry) {}

  /// Never blocks for longer than a swap of pointers. Results and states are never dropped.
  /// All but telemetry ends a gather().
  void push(Telemetry message);
  void push(CommandResult result);
  void push(DeviceStatus status);
  void push(FieldHealth health);

  /// The uplink's word that samples wait for the broker: groups without an interval rest until they
  /// are through, where others keep their intervals. Uplink thread.
  void set_backed_up(bool backed_up) { backed_up_.store(backed_up, std::memory_order_relaxed); }
  bool is_backed_up() const { return backed_up_.load(std::memory_order_relaxed); }

  /// The field's word that it is to stop: a command that it gets from now on is answered, and not
  /// sent.
  void refuse_commands() { refuses_commands_.store(true, std::memory_order_relaxed); }
  bool refuses_commands() const { return refuses_commands_.load(std::memory_order_relaxed); }

  /// Has the uplink call this at a time of its own, after it has taken what was pushed before. Any
  /// thread; where the uplink has ended nobody calls it.
  using Call = std::function<void(SteadyTime now)>;
  void ask(Call call);

  /// Everything that waits. Uplink thread.
  Batch take();
  /// Returns when something was pushed or notify() was called since the last return, or at
  /// `deadline`.
  void wait_until(SteadyTime deadline);
  /// Lets telemetry gather until `deadline`; anything else that was pushed, or a notify(), ends it.
  /// While samples stream, each pays then only for its share of a thread's waking up.
  void gather(SteadyTime deadline);
  /// Wakes wait_until(): the broker has news, or it is time to stop.
  void notify();

 private:
  template <class Put>
  void push_urgent(Put put);

  const std::size_t max_telemetry_;
  std::atomic<bool> backed_up_ = false;
  std::atomic<bool> refuses_commands_ = false;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool signalled_ = false;
  bool urgent_ = false;     ///< signalled by more than telemetry
  bool gathering_ = false;  ///< telemetry wakes nobody
  std::deque<Telemetry> telemetry_;
  std::uint64_t pushed_ = 0;
  Batch waiting_;  ///< all but the telemetry
};

}  // namespace fxagent
