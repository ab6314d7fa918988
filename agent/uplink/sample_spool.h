// Samples that cannot go out now: gathered for the disk, or in memory where there is none or where
// it refuses; the same rows again, oldest first, as history messages. What has to make room is
// counted. Uplink thread. Time is an argument.
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

#include "agent/messages.h"
#include "agent/store/backlog.h"
#include "agent/store/guarded_store.h"
#include "agent/store/history.h"
#include "agent/uplink/payload.h"

namespace fxagent {

/// A sample on its way to the broker.
struct LiveRow {
  SampleRow row;
  SteadyTime since{};
  bool stored = false;  ///< on disk too, and held there
};

/// One history message, and where its rows are.
struct OutgoingHistory {
  HistoryBatch batch;
  bool on_disk = false;
};

class SampleSpool final {
 public:
  /// A sample that waited longer is on disk, or else is history.
  static constexpr std::chrono::seconds kLiveFor{1};
  /// Rows for the disk are gathered so long.
  static constexpr std::chrono::milliseconds kCommitWithin{200};

  /// `store` outlives it; null: memory alone, of so many bytes.
  SampleSpool(GuardedStore* store, std::size_t backlog_bytes)
      : store_(store), backlog_(backlog_bytes) {}

  void add(SampleRow row) { spool_.push_back(std::move(row)); }
  /// Back from its way to the broker.
  void add(LiveRow live);
  /// What was added goes to the disk, several rows at once; or, where it cannot wait, now.
  void commit(SteadyTime now, bool can_wait);
  /// No later than `at`.
  void commit_by(SteadyTime at) { commit_at_ = std::min(commit_at_, at); }
  /// Now, to the disk or into memory.
  void write();
  /// What is in memory, once the disk takes it again.
  void move_memory_to_disk();
  /// Writes rows that stay on their way: true: they are on disk and held there.
  bool hold(std::vector<SampleRow>& rows);
  bool can_hold() const { return store_ != nullptr && store_->is_writable(); }

  /// The next history message of a device that `may_send`. Rows in memory are younger than those of
  /// the same stream on disk, and wait for them.
  std::optional<OutgoingHistory> next(Payload& payload, std::size_t max_bytes,
                                      const std::function<bool(const std::string&)>& may_send);
  void returned(const OutgoingHistory& message);
  /// The message is over. `then` gets the number of its rows that were still here; later, if the
  /// disk does not answer now.
  void remove(const OutgoingHistory& message, const GuardedStore::Removed& then);
  /// A row that was held is over: 1 if it was still here.
  void remove(const LiveRow& live, const GuardedStore::Removed& then);

  /// Samples that are gone, of a device that may be in the store alone.
  void drop(const std::string& device, std::uint64_t count);
  /// Takes into account what had to make room.
  void count_dropped();
  std::uint64_t dropped() const { return dropped_total_; }
  std::uint64_t dropped(const std::string& device) const;

  bool empty() const { return spool_.empty() && backlog_.rows() == 0; }
  std::size_t gathered() const { return spool_.size(); }
  /// Rows that the disk was given and has not answered for.
  std::uint64_t at_disk() const { return store_ == nullptr ? 0 : store_->samples_at_disk(); }
  SteadyTime commit_at() const { return commit_at_; }
  bool has_waiting(const std::string& device) const;
  const Backlog& backlog() const { return backlog_; }

 private:
  /// To the disk, or into memory if the disk refuses.
  void store(std::vector<SampleRow> rows);

  GuardedStore* const store_;
  Backlog backlog_;
  std::vector<SampleRow> spool_;  ///< for the store, at the next commit
  SteadyTime commit_at_{};
  /// By name: the store may hold rows of devices that the config no longer has.
  std::map<std::string, std::uint64_t> dropped_;
  std::uint64_t dropped_total_ = 0;
};

}  // namespace fxagent
