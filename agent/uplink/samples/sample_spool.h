// Samples that cannot be sent now. SampleSpool gathers them. WaitingSamples keeps them on disk, or
// in memory if there is no disk or it refuses. DroppedSamples counts those lost. RefusedDevices has
// the devices whose samples the broker refuses for a time. Uplink thread. Time is an argument.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "agent/steady_time.h"
#include "agent/store/guarded_store.h"
#include "agent/store/samples/backlog.h"
#include "agent/store/samples/history.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/jittered_backoff.h"
#include "agent/uplink/payload/payload.h"

namespace fxagent {

struct SampleCounts;

/// Place that was full and caused a loss. `refused`: the broker or the format does not accept it.
enum class DropCause : std::uint8_t { outbox, memory, store, refused };

/// End of a sample that needs no more messages. `refused`: it counts as dropped.
enum class SampleEnd : std::uint8_t { acknowledged, refused };

/// Counts the samples that were lost: dropped to make room, or refused for good.
class DroppedSamples final {
 public:
  /// The device may exist only in the store.
  void add(const std::string& device, std::uint64_t count, DropCause cause) {
    by_device_[device] += count;
    total_ += count;
    if (count != 0) last_cause_ = cause;
  }
  DropCause last_cause() const { return last_cause_; }
  std::uint64_t total() const { return total_; }
  std::uint64_t of(const std::string& device) const {
    const auto found = by_device_.find(device);
    return found == by_device_.end() ? 0 : found->second;
  }

 private:
  /// By device name: the store may have rows of devices that the config no longer has.
  std::map<std::string, std::uint64_t> by_device_;
  std::uint64_t total_ = 0;
  DropCause last_cause_ = DropCause::outbox;
};

/// Devices whose samples the broker refuses for a time, or the library rejects: each has a pause
/// that grows with every refusal.
class RefusedDevices final {
 public:
  /// `backoff` outlives the object.
  explicit RefusedDevices(JitteredBackoff& backoff) : backoff_(backoff) {}

  /// Ends all pauses: a new connection has begun.
  void clear() { pauses_.clear(); }
  /// The broker refused a message with samples of the device. Begins a pause, or goes on with it.
  void refused(const std::string& device, const DeliveryFailed& event, SteadyTime now);
  /// The broker accepted a message that was sent at `since`. Ends the device's pause, unless the
  /// message was sent before the refusal.
  void accepted(const std::string& device, SteadyTime since);

  bool may_send(const std::string& device, SteadyTime now) const;
  /// Returns the MQTT reason code of the broker's refusal of the device's samples; nullopt: none.
  std::optional<int> reason(const std::string& device) const;
  /// Returns the next end of a pause of a device for which `matters` is true.
  SteadyTime next_end(SteadyTime now, const std::function<bool(const std::string&)>& matters) const;

 private:
  struct Pause {
    SteadyTime since{};  ///< of the last refusal
    SteadyTime until{};
    int failures = 0;
    int reason_code = 0;  ///< 0: the library rejects the samples
  };

  JitteredBackoff& backoff_;
  std::map<std::string, Pause> pauses_;  ///< by device name, as in the store
};

/// A sample on its way to the broker.
struct LiveRow {
  SampleRow row;
  SteadyTime since{};
  bool stored = false;  ///< also on disk, and held there
};

/// A history message, and where its rows are.
struct OutgoingHistory {
  std::vector<Publication> publications;  ///< deliver it together; none: it cannot be delivered
  HistoryBatch batch;
  bool on_disk = false;
};

/// Samples that wait on disk, or in memory if there is no disk or it refuses. They leave as history
/// messages, oldest first. Counts the rows that must make room, and the samples that are complete.
class WaitingSamples final {
 public:
  /// `store` outlives the object. No store: rows are kept in `backlog_bytes` of memory.
  WaitingSamples(GuardedStore* store, std::size_t backlog_bytes)
      : store_(store), backlog_(backlog_bytes) {}
  WaitingSamples& operator=(WaitingSamples&&) = delete;  // the disk's answers come to its address

  /// GuardedStore::upkeep(), and counts what the store has dropped. Does nothing without a store.
  void upkeep(SteadyTime now, std::int64_t utc_ms);
  /// Writes rows to the disk, or into memory if the disk refuses.
  void append(std::vector<SampleRow> rows);
  /// Moves rows from memory to the disk, once it accepts them again.
  void move_memory_to_disk();
  bool can_write() const { return store_ != nullptr && store_->is_writable(); }

  /// Returns the next history message, in the form of `payload`, of a device for which `may_send`
  /// is true; nullopt if there is none. No other message of its stream leaves until returned() or
  /// remove() is called with it, once. Rows in memory are younger than those of the same stream on
  /// disk, and wait for them.
  std::optional<OutgoingHistory> next(SamplePayload& payload, std::size_t max_bytes,
                                      const std::function<bool(const std::string&)>& may_send);
  /// Call if the message did not arrive. Its rows wait again, in their old places.
  void returned(const OutgoingHistory& message);
  /// Removes the rows of a message or live sample that is complete. Counts those that still
  /// existed: later if the disk does not answer now.
  void remove(const OutgoingHistory& message, SampleEnd end);
  void remove(const LiveRow& live, SampleEnd end);

  bool has_waiting(const std::string& device) const;
  const Backlog& backlog() const { return backlog_; }
  DroppedSamples& dropped() { return dropped_; }
  const DroppedSamples& dropped() const { return dropped_; }
  /// Counts the rows that backlog and store have dropped to make room. Call after each write.
  void count_dropped();
  /// Adds the samples that wait here, were recovered from the store, acknowledged or dropped.
  void add_to(SampleCounts& counts) const;

 private:
  void store(std::vector<SampleRow> rows);
  /// Returns the function that counts removed samples. The disk may call it later.
  GuardedSamples::Removed counted_as(SampleEnd end, const std::string& device);

  GuardedStore* const store_;
  Backlog backlog_;
  DroppedSamples dropped_;
  std::uint64_t acknowledged_ = 0;
};

/// Gathers samples that cannot be sent now, and writes several at once. Also keeps on disk those
/// live samples that the broker has not acknowledged within kLiveFor.
class SampleSpool final {
 public:
  /// A sample that has waited longer is on disk, or is history.
  static constexpr std::chrono::seconds kLiveFor{1};
  /// Longest time for which rows are gathered for the disk.
  static constexpr std::chrono::milliseconds kCommitWithin{200};

  /// `store` and `backlog_bytes` are those of WaitingSamples.
  SampleSpool(GuardedStore* store, std::size_t backlog_bytes)
      : store_(store), waiting_(store, backlog_bytes) {}

  /// The samples after their commit. Valid as long as this object.
  WaitingSamples& waiting() { return waiting_; }
  const WaitingSamples& waiting() const { return waiting_; }

  /// Notes in the store that the number is in use. Call before the sample leaves the agent.
  void used(const std::string& device, std::uint64_t seq) {
    if (store_ != nullptr) store_->samples().used(device, seq);
  }

  void add(SampleRow row) { spool_.push_back(std::move(row)); }
  /// Takes back a sample that was on its way to the broker.
  void add(LiveRow live);
  /// Writes the added rows to the disk, several at once; immediately if they cannot wait.
  void commit(SteadyTime now, bool can_wait);
  /// True if an added row of the stream is due for the disk.
  bool is_due(const StreamKey& stream, SteadyTime now) const;
  /// Makes the next commit happen by `at`.
  void commit_by(SteadyTime at) { commit_at_ = std::min(commit_at_, at); }
  /// Writes rows that stay in flight. True: they are on disk and held there.
  bool hold(std::vector<SampleRow>& rows);
  /// Writes everything to the disk and closes the store, if there is one.
  void close();

  bool empty() const { return spool_.empty() && waiting_.backlog().rows() == 0; }
  /// Returns the time by which commit(), or upkeep() for rows at the disk, must run.
  SteadyTime next_wake(SteadyTime now) const;
  /// Adds the samples gathered here, and those of waiting().
  void add_to(SampleCounts& counts) const;

 private:
  GuardedStore* const store_;
  WaitingSamples waiting_;
  std::vector<SampleRow> spool_;  ///< for the store, at the next commit
  SteadyTime commit_at_{};
};

}  // namespace fxagent
