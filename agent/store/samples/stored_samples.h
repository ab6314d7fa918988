// The samples on disk that the broker has not acknowledged: written, sent as history messages, and
// removed. More than twenty functions: many are StorePart's, or forward to sample_streams.h. The
// store's thread.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "agent/store/disk/store_disk.h"
#include "agent/store/journal/stored_journal.h"
#include "agent/store/samples/history.h"
#include "agent/store/samples/sample_streams.h"
#include "agent/store/samples/sequence_numbers.h"

namespace fxagent {

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
  /// Returns the next history message, like Backlog::next(). Drops and counts damaged rows: one of
  /// them would spoil the whole message.
  std::optional<HistoryBatch> next(HistoryMessage& message, const MaySend& may_send);
  /// Returns the stream that next() begins with. Memory only.
  std::optional<StreamKey> next_stream(const MaySend& may_send) const {
    return streams_.oldest_waiting(may_send);
  }
  /// Call when the rows are delivered, or never will be. Returns how many were still here; rows
  /// that had to make room were counted as dropped already.
  std::uint64_t remove(std::span<const std::uint64_t> row_ids);
  std::uint64_t remove(const HistoryBatch& batch);
  /// Call when the batch did not arrive. Its rows wait again.
  void returned(const HistoryBatch& batch);
  /// Call when a held row did not arrive. It waits for a history message.
  void release(std::uint64_t row_id) { streams_.release(row_id); }

  std::uint64_t rows() const override { return streams_.rows(); }
  std::uint64_t bytes() const { return streams_.bytes(); }
  std::uint64_t recovered() const { return recovered_; }  ///< rows found when a file opened
  bool has_waiting(const std::string& device) const { return streams_.has_waiting(device); }
  bool has_waiting(const StreamKey& stream) const { return streams_.has_waiting(stream); }
  bool is_on_the_way(const StreamKey& stream) const { return streams_.is_on_the_way(stream); }
  /// Rows dropped since the last call, by device: for lack of room, for age, damaged, or lost with
  /// their file.
  std::map<std::string, std::uint64_t> take_dropped() { return std::exchange(dropped_, {}); }

  /// Removed rows that are still in the file.
  std::size_t removed_waiting() const { return removed_.size(); }
  /// Deletes rows older than max_age.
  void drop_old();
  /// Deletes the oldest rows above max_bytes, with commands counted.
  void drop_excess();

  /// Counts the rows now in the file as left by earlier runs.
  void count_recovered() { recovered_ += streams_.rows(); }
  /// Rows added after this call count as this run's.
  void begin_run() { first_of_run_ = next_row_id_; }
  /// Within a commit: shifts the times of this run's rows, after the calendar was set. Throws
  /// SQLite::Exception.
  void move_times(std::int64_t by_ms);

  void load(SQLite::Database& database) override;
  void unload(Rows rows) override;
  bool has_pending() const override { return !removed_.empty(); }
  bool write_pending(std::size_t at_most) override;
  void begin_commit() override { is_removal_written_ = false; }
  void committed() override;

 private:
  struct Statements {
    explicit Statements(SQLite::Database& database);
    SQLite::Statement insert;
    SQLite::Statement remove;
    SQLite::Statement stream;
    SQLite::Statement oldest;
  };

  /// Deletes the oldest rows within the caller's commit, until `excess` bytes are free and no row
  /// is older than `older_than_ms`.
  std::vector<SampleStreams::Row> delete_oldest(std::uint64_t excess, std::int64_t older_than_ms);
  void forget(const std::vector<SampleStreams::Row>& gone);
  void drop(std::uint64_t excess, std::int64_t older_than_ms);
  /// next() of one stream. Returns nullopt if it had no row to send, or the file cannot be read.
  /// `dropped` is the number of damaged rows that were dropped.
  std::optional<HistoryBatch> next_of(const StreamKey& key, HistoryMessage& message,
                                      std::size_t& dropped);
  void drop_damaged(const std::vector<SampleStreams::Row>& damaged);

  const StoreConfig config_;
  StoreDisk& disk_;
  const StoredJournal& journal_;
  SequenceNumbers& numbers_;
  std::optional<Statements> sql_;
  SampleStreams streams_;
  std::set<std::uint64_t> removed_;  ///< still in the file
  bool is_removal_written_ = false;  ///< in the open commit
  std::map<std::string, std::uint64_t> dropped_;
  std::uint64_t next_row_id_ = 1;
  std::uint64_t first_of_run_ = 0;
  std::uint64_t recovered_ = 0;
};

}  // namespace fxagent
