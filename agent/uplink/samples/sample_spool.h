// Samples that cannot be sent now. They are gathered for the disk, or kept in memory if there is no
// disk or it refuses. They leave as history messages, oldest first. Rows that must make room are
// counted. Uplink thread. Time is an argument.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "agent/steady_time.h"
#include "agent/store/guarded_store.h"
#include "agent/store/samples/backlog.h"
#include "agent/store/samples/history.h"
#include "agent/uplink/payload/payload.h"
#include "agent/uplink/samples/dropped_samples.h"

namespace fxagent {

/// A sample on its way to the broker.
struct LiveRow {
  SampleRow row;
  SteadyTime since{};
  bool stored = false;  ///< also on disk, and held there
};

/// A history message, and where its rows are.
struct OutgoingHistory {
  HistoryBatch batch;
  bool on_disk = false;
};

class SampleSpool final {
 public:
  /// A sample that has waited longer is on disk, or is history.
  static constexpr std::chrono::seconds kLiveFor{1};
  /// Longest time for which rows are gathered for the disk.
  static constexpr std::chrono::milliseconds kCommitWithin{200};

  /// `store` and `dropped` outlive the object. No store: rows are kept in `backlog_bytes` of
  /// memory.
  SampleSpool(GuardedStore* store, std::size_t backlog_bytes, DroppedSamples& dropped)
      : store_(store), backlog_(backlog_bytes), dropped_(dropped) {}

  void add(SampleRow row) { spool_.push_back(std::move(row)); }
  /// Takes back a sample that was on its way to the broker.
  void add(LiveRow live);
  /// Writes the added rows to the disk, several at once; immediately if they cannot wait.
  void commit(SteadyTime now, bool can_wait);
  /// Makes the next commit happen by `at`.
  void commit_by(SteadyTime at) { commit_at_ = std::min(commit_at_, at); }
  /// Writes the added rows now, to the disk or into memory.
  void write();
  /// Moves rows from memory to the disk, once it accepts them again.
  void move_memory_to_disk();
  /// Writes rows that stay in flight. True: they are on disk and held there.
  bool hold(std::vector<SampleRow>& rows);
  bool can_hold() const { return store_ != nullptr && store_->is_writable(); }

  /// Returns the next history message of a device for which `may_send` is true. Rows in memory are
  /// younger than those of the same stream on disk, and wait for them.
  std::optional<OutgoingHistory> next(SamplePayload& payload, std::size_t max_bytes,
                                      const std::function<bool(const std::string&)>& may_send);
  void returned(const OutgoingHistory& message);
  /// Removes the rows of a message that is complete. `then` gets the number of rows that still
  /// existed; it is called later if the disk does not answer now.
  void remove(const OutgoingHistory& message, const GuardedSamples::Removed& then);
  /// Removes a held row that is complete. `then` gets 1 if it still existed.
  void remove(const LiveRow& live, const GuardedSamples::Removed& then);

  /// Counts the rows that backlog and store have dropped to make room.
  void count_dropped();

  bool empty() const { return spool_.empty() && backlog_.rows() == 0; }
  std::size_t gathered() const { return spool_.size(); }
  /// Rows passed to the disk and not confirmed yet.
  std::uint64_t at_disk() const { return store_ == nullptr ? 0 : store_->samples().at_disk(); }
  SteadyTime commit_at() const { return commit_at_; }
  bool has_waiting(const std::string& device) const;
  const Backlog& backlog() const { return backlog_; }

 private:
  /// Writes to the disk, or into memory if the disk refuses.
  void store(std::vector<SampleRow> rows);

  GuardedStore* const store_;
  Backlog backlog_;
  DroppedSamples& dropped_;
  std::vector<SampleRow> spool_;  ///< for the store, at the next commit
  SteadyTime commit_at_{};
};

}  // namespace fxagent
