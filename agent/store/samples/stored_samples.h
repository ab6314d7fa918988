// The samples on disk that the broker has not acknowledged: written, sent as history messages, and
// removed. SampleStreams knows which of them wait. The store's thread.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "agent/store/disk/sqlite.h"
#include "agent/store/disk/store_disk.h"
#include "agent/store/journal/stored_journal.h"
#include "agent/store/samples/history.h"
#include "agent/store/samples/sample_streams.h"
#include "agent/store/samples/sequence_numbers.h"

namespace fxagent {

/// Limit of the config for which samples were dropped.
enum class StoreLimit : std::uint8_t { none, max_bytes, max_age };

class StoredSamples final : public StorePart {
 public:
  /// `yes`: rows are on their way as live messages, so no history message may take them yet.
  enum class Hold : std::uint8_t { no, yes };

  /// The referenced objects outlive it.
  StoredSamples(const StoreConfig& config, StoreDisk& disk, const StoredJournal& journal,
                SequenceNumbers& numbers)
      : config_(config), disk_(disk), journal_(journal), numbers_(numbers) {}

  /// Writes all rows in one commit, synchronised with the disk, and sets their `row_id`. If samples
  /// and commands exceed max_bytes, deletes the oldest rows. Returns false if none was written;
  /// then none has changed.
  bool append(std::vector<SampleRow>& rows, Hold hold);
  /// Fills `message`, which must be empty, with the oldest waiting rows of the stream. No other
  /// message may take them until remove() or returned(). Drops and counts damaged rows: one of them
  /// would spoil the whole message. Returns nullopt if no row waits, or the file cannot be read.
  /// Call only while no message of the stream is on its way.
  std::optional<HistoryBatch> next(const StreamKey& stream, HistoryMessage& message);
  /// Call when the rows are delivered, or never will be. Returns how many were still here; rows
  /// that had to make room were counted as dropped already.
  std::uint64_t remove(std::uint64_t row_id);
  std::uint64_t remove(const HistoryBatch& batch);
  /// Number of removed rows that are still in the file; the next commit deletes them.
  std::size_t removed() const { return removed_.size(); }
  /// Call when the batch did not arrive. Its rows wait again.
  void returned(const HistoryBatch& batch);
  /// Call when a held row did not arrive. It waits for a history message.
  void release(std::uint64_t row_id) { streams_.release(row_id); }

  /// The streams of its rows. Memory only.
  const SampleStreams& streams() const { return streams_; }
  std::uint64_t rows() const override { return streams_.rows(); }
  /// Rows of earlier runs that were counted at open, also of a file whose damage was found later.
  std::uint64_t recovered() const { return recovered_; }
  /// Rows dropped since the last call, by device: no room, too old, damaged, or lost with the file.
  std::map<std::string, std::uint64_t> take_dropped() { return std::exchange(dropped_, {}); }
  /// Limit for which rows were dropped last; none: they were damaged, or lost with their file.
  StoreLimit dropped_by() const { return dropped_by_; }

  /// Deletes rows older than max_age.
  void drop_old();
  /// Deletes the oldest rows above max_bytes, with commands counted.
  void drop_excess();

  /// Rows added after this call count as this run's.
  void begin_run() { first_of_run_ = next_row_id_; }

  void load(SQLite::Database& database) override;
  void unload(Rows rows) override;
  bool has_pending() const override { return !removed_.empty(); }
  void begin_commit() override { is_removal_written_ = false; }
  bool write_pending(std::size_t at_most) override;
  void committed() override;
  void move_stored_times(std::int64_t by_ms) override;

 private:
  struct Statements {
    explicit Statements(SQLite::Database& database);
    SQLite::Statement insert;
    SQLite::Statement remove;
    SQLite::Statement stream;  ///< the rows of a stream, in the order of its samples
    SQLite::Statement oldest;  ///< all rows, oldest first
  };

  /// Within a commit: deletes the oldest rows until `excess` bytes are free and no row is older
  /// than `older_than_ms`. Returns them. Throws SQLite::Exception.
  std::vector<SampleStreams::Row> delete_oldest(std::uint64_t excess, std::int64_t older_than_ms);
  void forget(const std::vector<SampleStreams::Row>& gone, StoreLimit limit);
  void drop(std::uint64_t excess, std::int64_t older_than_ms);
  void count_dropped(const std::string& device, std::uint64_t count, StoreLimit limit) {
    dropped_[device] += count;
    dropped_by_ = limit;
  }

  const StoreConfig config_;
  StoreDisk& disk_;
  const StoredJournal& journal_;
  SequenceNumbers& numbers_;
  std::optional<Statements> sql_;  ///< of the open file
  SampleStreams streams_;
  std::set<std::uint64_t> removed_;  ///< row ids, still in the file
  bool is_removal_written_ = false;  ///< in the open commit
  std::map<std::string, std::uint64_t> dropped_;
  StoreLimit dropped_by_ = StoreLimit::none;
  std::uint64_t next_row_id_ = 1;
  std::uint64_t first_of_run_ = 0;
  std::uint64_t recovered_ = 0;
};

}  // namespace fxagent
