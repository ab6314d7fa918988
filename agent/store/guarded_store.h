// The store as the uplink uses it. Everything that may touch the disk runs on the disk's thread,
// and the uplink waits for it at most 2 s: a disk that hangs must not hold up samples and results.
//
// Work that takes longer is overdue, and the store hangs: nothing else touches it until the disk
// has answered. Until then writes are refused, as by a full disk. Notes wait here, bounded. The
// first upkeep() after the answer passes them to the store, after the outcome of the overdue work.
//
// Uplink thread; before that thread starts, the thread that made it. More than twenty functions:
// most are CommandJournal's, or forward one call.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/steady_time.h"
#include "agent/store/disk/disk_thread.h"
#include "agent/store/journal/command_marker.h"
#include "agent/store/journal/unrecorded_commands.h"
#include "agent/store/samples/history.h"
#include "agent/store/store.h"

namespace fxagent {

class GuardedStore final : public CommandJournal {
 public:
  /// `store` outlives it. Calls `wake` on the disk's thread when overdue work has ended; call
  /// upkeep() then.
  GuardedStore(Store& store, std::function<void()> wake)
      : store_(store), thread_(std::move(wake)) {}
  void set_patience(std::chrono::milliseconds patience) {
    thread_.set_patience(patience);
    marker_.set_patience(patience);
  }

  /// "disk"; "memory" if nothing can be written; "hangs" while the disk does not answer.
  std::string_view state() const { return hangs_ ? "hangs" : store_.state(); }
  bool is_writable() const { return !hangs_ && store_.is_writable(); }
  std::uint64_t max_bytes() const { return store_.max_bytes(); }
  bool has_pending() const { return !hangs_ && store_.has_pending(); }

  /// Figures of the store. While it hangs, those from before.
  struct Figures {
    std::uint64_t rows = 0;
    std::uint64_t recovered = 0;
    std::uint64_t bytes = 0;
    std::string set_aside;
    audit::Head audit;
  };
  Figures figures() const { return hangs_ ? seen_ : look(); }
  /// Samples in overdue work; no other figure includes them.
  std::uint64_t samples_at_disk() const { return samples_at_disk_; }

  /// Store::upkeep(). After overdue work, first handles its outcome and the notes that have waited.
  void upkeep(SteadyTime now, std::int64_t utc_ms);
  std::optional<Store::FoundLate> take_found_late();
  void close();

  // Samples, as in StoredSamples.
  /// Receives the rows, and true if they are on disk. A later upkeep() calls it if the work is
  /// overdue.
  using Stored = std::function<void(std::vector<SampleRow> rows, bool on_disk)>;
  void append(std::vector<SampleRow> rows, Stored then);
  /// Writes rows that stay on their way as live messages. Returns false if none is on disk, and
  /// none will count as stored later.
  bool hold(std::vector<SampleRow>& rows);
  std::optional<HistoryBatch> next(std::shared_ptr<HistoryMessage> message,
                                   const MaySend& may_send);
  void returned(const HistoryBatch& batch);
  void release(std::uint64_t row_id);
  /// Receives the number of rows that were still there. A later upkeep() calls it if the store
  /// hangs.
  using Removed = std::function<void(std::uint64_t count)>;
  void remove(const HistoryBatch& batch, Removed then);
  void remove(std::uint64_t row_id, Removed then);
  bool has_waiting(const std::string& device) const;
  /// True if a row of the stream is on disk, or may be. Younger rows wait for it.
  bool is_ahead_of_memory(const StreamKey& stream) const;
  std::map<std::string, std::uint64_t> take_dropped();

  // Numbers, as in SequenceNumbers.
  void used(const std::string& device, std::uint64_t seq);
  std::vector<std::uint64_t> join(const std::vector<std::string>& devices, std::int64_t utc_ms);

  // CommandJournal.
  std::uint64_t next_command_number() override { return store_.journal().next_command_number(); }
  void note(std::string audit) override;
  bool journal(std::span<const JournalEntry> entries) override;
  bool hangs() const override { return hangs_; }
  void record(JournalEntry entry) override;
  void record(std::vector<JournalEntry> entries) override;
  void acknowledge(std::string device, std::string id, std::uint64_t number,
                   std::string total_ms = {}) override;
  CommandStarts* starts() override { return &marker_; }
  std::optional<JournalEntry> find(const std::string& device, const std::string& id) override;
  std::vector<KnownId> known_ids() override { return known_ids_of({}); }
  std::vector<JournalEntry> unacknowledged() override { return unacknowledged_of({}); }
  std::vector<KnownId> known_ids_of(const std::string& device) override;
  std::vector<JournalEntry> unacknowledged_of(const std::string& device) override;

 private:
  /// Notes that wait while the store hangs.
  struct Waiting {
    std::vector<std::function<void()>> samples;  ///< few: of messages on their way
    std::map<std::string, std::uint64_t> used;
    std::vector<std::string> joined;
    std::deque<std::string> audit;
    std::size_t audit_bytes = 0;
    std::uint64_t audit_lost = 0;  ///< records that found no room
    UnrecordedCommands results;
    std::vector<std::function<void()>> acknowledgements;
  };

  Figures look() const;
  bool run(DiskThread::Work work, std::function<void()> late = {});
  template <class Result>
  Result ask(std::function<Result()> question);
  void take_up(std::int64_t utc_ms);
  void collect_dropped();

  Store& store_;
  bool hangs_ = false;
  std::function<void()> late_;                    ///< called when the overdue work has ended
  Figures seen_;                                  ///< figures from before it began
  std::map<std::string, std::uint64_t> dropped_;  ///< until take_dropped(); not in seen_.rows
  std::uint64_t samples_at_disk_ = 0;
  std::set<StreamKey> streams_at_disk_;
  Waiting waiting_;
  CommandMarker marker_{[this](std::uint64_t number) { store_.started().mark(number); }};
  DiskThread thread_;  ///< last: its work refers to the others
};

}  // namespace fxagent
