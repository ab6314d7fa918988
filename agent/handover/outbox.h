// Passes messages and calls from the field thread to the uplink thread, and two flags back. Any
// thread.
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

#include "agent/handover/command_message.h"
#include "agent/handover/field_health.h"
#include "agent/handover/telemetry.h"

namespace fxagent {

class Outbox final {
 public:
  /// Contents handed over by one take(). Each list is in push order.
  struct Batch {
    std::vector<CommandResult> results;
    std::vector<DeviceStatus> states;
    std::vector<Telemetry> telemetry;
    std::optional<FieldHealth> health;  ///< the newest only
    std::map<std::uint32_t, std::uint64_t>
        dropped;  ///< telemetry dropped since the last take, by device
    /// Telemetry pushed since the outbox was created, including dropped messages. After a take() it
    /// is the number of samples that the uplink must account for.
    std::uint64_t pushed = 0;
    /// Value of `pushed` when `health` was pushed. The field's own counters must agree with it.
    std::uint64_t pushed_at_health = 0;
    std::vector<std::function<void(SteadyTime now)>> calls;  ///< to run after the rest is processed
  };

  /// Holds at most `max_telemetry` messages. Beyond that it drops the oldest and counts it.
  explicit Outbox(std::size_t max_telemetry) : max_telemetry_(max_telemetry) {}

  // ---- the field: messages to the uplink ----

  /// Never blocks longer than a pointer swap. Never drops results or states. Everything except
  /// telemetry ends a gather().
  void push(Telemetry message);
  void push(CommandResult result);
  void push(DeviceStatus status);
  void push(FieldHealth health);

  // ---- the uplink ----

  /// Removes and returns everything that waits.
  Batch take();
  /// Returns at `deadline`, or after the first push or notify() since the last return.
  void wait_until(SteadyTime deadline);
  /// Collects telemetry until `deadline`. Any other push, or notify(), ends it early. Under a
  /// steady flow of samples, many of them then share the cost of one thread wake-up.
  void gather(SteadyTime deadline);

  // ---- any thread, to the uplink ----

  /// Makes the uplink run `call` on its own thread, after it has processed everything pushed
  /// before. Once the uplink has ended, `call` is never run.
  using Call = std::function<void(SteadyTime now)>;
  void post(Call call);
  /// Wakes wait_until(): the broker has an event, or the agent is stopping.
  void notify();
  /// Marks that the agent is stopping. The uplink then answers every later command with a rejection
  /// and sends it to no device.
  void refuse_commands() { refuses_commands_.store(true, std::memory_order_relaxed); }
  bool refuses_commands() const { return refuses_commands_.load(std::memory_order_relaxed); }
  /// Returns the highest sequence number of all telemetry so far.
  std::uint64_t highest_seq() const { return highest_seq_.load(std::memory_order_relaxed); }

  // ---- the uplink's flags for the field: set by the uplink, read on any thread ----

  /// Sets whether samples are waiting for the broker, or it is away. Groups without an interval are
  /// then polled about once a second; all other groups keep their intervals.
  void set_backed_up(bool backed_up) { backed_up_.store(backed_up, std::memory_order_relaxed); }
  bool is_backed_up() const { return backed_up_.load(std::memory_order_relaxed); }
  /// Sets whether another agent has our id. The field then rejects the commands that wait, and a
  /// running one writes nothing more.
  void set_conflict(bool in_conflict) {
    in_conflict_.store(in_conflict, std::memory_order_relaxed);
  }
  bool is_in_conflict() const { return in_conflict_.load(std::memory_order_relaxed); }

 private:
  template <class Put>
  void push_urgent(Put put);

  const std::size_t max_telemetry_;
  std::atomic<bool> backed_up_ = false;
  std::atomic<bool> refuses_commands_ = false;
  std::atomic<bool> in_conflict_ = false;
  std::atomic<std::uint64_t> highest_seq_ = 0;  ///< changed by the field thread
  std::mutex mutex_;
  std::condition_variable changed_;
  bool signalled_ = false;
  bool urgent_ = false;     ///< signalled by something other than telemetry
  bool gathering_ = false;  ///< telemetry does not wake the uplink
  std::deque<Telemetry> telemetry_;
  std::uint64_t pushed_ = 0;
  Batch waiting_;  ///< everything except telemetry
};

}  // namespace fxagent
