// The stored samples and their sequence numbers while the disk may hang. Then writes are refused,
// as by a full disk, and changes of rows wait in memory until take_up().
//
// Threads as for DiskGuard.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "agent/store/disk/disk_guard.h"
#include "agent/store/samples/history.h"
#include "agent/store/samples/sequence_numbers.h"
#include "agent/store/samples/stored_samples.h"

namespace fxagent {

class GuardedSamples final {
 public:
  /// The referenced objects outlive it, except `guard`: it ends first, with its thread.
  GuardedSamples(StoredSamples& samples, SequenceNumbers& numbers, DiskGuard& guard)
      : samples_(samples), numbers_(numbers), guard_(guard) {}

  // As in StoredSamples.
  /// Gets the rows, and true if they are on disk. Overdue: GuardedStore::upkeep() calls it later.
  using Stored = std::function<void(std::vector<SampleRow> rows, bool on_disk)>;
  void append(std::vector<SampleRow> rows, Stored then);
  /// Writes rows that stay on their way as live messages. Returns false if none is on disk, and
  /// none will count as stored later.
  bool hold(std::vector<SampleRow>& rows);
  std::optional<HistoryBatch> next(std::shared_ptr<HistoryMessage> message,
                                   const MaySend& may_send);
  void returned(const HistoryBatch& batch);
  void release(std::uint64_t row_id);
  /// Receives the number of rows that were still there. GuardedStore::upkeep() calls it later if
  /// the store hangs.
  using Removed = std::function<void(std::uint64_t count)>;
  void remove(const HistoryBatch& batch, Removed then);
  void remove(std::uint64_t row_id, Removed then);
  bool has_waiting(const std::string& device) const;
  /// True if rows of the stream wait on disk or are on their way from there, or may be. Rows in
  /// memory are younger and wait for them.
  bool is_ahead_of_memory(const StreamKey& stream) const;
  std::map<std::string, std::uint64_t> take_dropped();
  /// Samples in overdue work; no other figure includes them.
  std::uint64_t at_disk() const { return at_disk_; }

  // As in SequenceNumbers.
  void used(const std::string& device, std::uint64_t seq);
  std::vector<std::uint64_t> join(const std::vector<std::string>& devices, std::int64_t utc_ms);

  /// Call before the disk's thread begins work. Saves what is_ahead_of_memory() and take_dropped()
  /// return while it hangs.
  void remember();
  /// Call after a hang. Passes the changes that have waited to the store. Returns the rest of them:
  /// work for the disk.
  DiskGuard::Work take_up(std::int64_t utc_ms);

 private:
  /// Changes that wait while the store hangs.
  struct Waiting {
    std::vector<std::function<void()>> rows;  ///< few: of messages on their way
    std::map<std::string, std::uint64_t> used;
    std::vector<std::string> joined;
  };

  void change(std::function<void()> rows);

  StoredSamples& samples_;
  SequenceNumbers& numbers_;
  DiskGuard& guard_;
  bool had_rows_ = false;                         ///< before the last work of the disk
  std::map<std::string, std::uint64_t> dropped_;  ///< until take_dropped()
  std::uint64_t at_disk_ = 0;
  std::set<StreamKey> streams_at_disk_;
  Waiting waiting_;
};

}  // namespace fxagent
