// The journal of commands on disk. Entries that the database refuses wait in memory, and in
// UnrecordedFile for a restart, until it accepts them. An audit record is in the same commit as its
// entry, unless the disk refused that commit. The store's thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/store/audit_trail.h"
#include "agent/store/disk/store_disk.h"
#include "agent/store/journal/command_table.h"
#include "agent/store/journal/earlier_commands.h"
#include "agent/store/journal/started_commands.h"
#include "agent/store/journal/unrecorded_commands.h"
#include "agent/store/journal/unrecorded_file.h"

namespace fxagent {

class StoredJournal final : public CommandJournal, public StorePart {
 public:
  /// The referenced objects outlive it.
  StoredJournal(const StoreConfig& config, StoreDisk& disk, AuditTrail& audit,
                StartedCommands& started)
      : config_(config),
        disk_(disk),
        audit_(audit),
        started_(started),
        unrecorded_file_(config.path) {}

  std::uint64_t next_command_number() override { return audit_.next_command_number(); }
  void note(std::string audit) override { audit_.note(std::move(audit)); }
  bool journal(std::span<const JournalEntry> entries) override;
  using CommandJournal::record;
  void record(std::vector<JournalEntry> entries) override;
  void acknowledge(std::string device, std::string id, std::uint64_t number,
                   std::string total_ms = {}) override;
  std::optional<JournalEntry> find(const std::string& device, const std::string& id) override;
  std::vector<KnownId> known_ids(const std::string& device = {}) override;
  std::vector<JournalEntry> unacknowledged(const std::string& device = {}) override;
  /// Same, without the entries that unwritten() has.
  std::vector<JournalEntry> unacknowledged_in_file(const std::string& device = {});
  bool was_read() const override { return was_read_; }
  /// True if a call without a device has failed, but the file is not damaged. Until take_unread(),
  /// every such read returns nothing, also for one device. Call them again when the disk is
  /// writable.
  bool take_unread() { return std::exchange(is_unread_, false); }

  /// Bytes of commands in the file: as committed, and as the open commit will leave them.
  std::uint64_t bytes() const { return table_ ? table_->bytes() : 0; }
  std::uint64_t bytes_in_commit() const { return table_ ? table_->bytes_in_commit() : 0; }
  /// Commands and results that are not in the file yet.
  std::size_t unrecorded() const { return waiting_.size(); }
  /// Returns every entry of which the disk has refused a part, as it stands in memory. Empty
  /// `device`: of all devices.
  std::vector<JournalEntry> unwritten(const std::string& device = {});

  /// Call if the database did not open at the start, while the directory is locked, before
  /// open_unrecorded_file(). Until load(), known_ids() also has the ids in the database, even of
  /// commands without a result; unacknowledged() has none of them.
  void read_earlier_runs() { earlier_.emplace(config_.path); }

  /// Opens or makes UnrecordedFile, unless it is open. Returns the entries of an earlier run in it
  /// that differ from the database; they are unwritten now, and command numbers continue above
  /// theirs. Call only while the directory is locked.
  std::vector<JournalEntry> open_unrecorded_file();
  /// True if keep_unrecorded() has something to write.
  bool has_unkept() const { return kept_ < to_acknowledge_.size() || have_times_moved_; }
  /// Call while the disk refuses: brings UnrecordedFile up to date with acknowledgements and times.
  void keep_unrecorded();

  /// If commands take more than half of max_bytes, deletes refused ones, then acknowledged results,
  /// oldest first. Samples make room for the rest.
  void shrink();
  /// Deletes ids that need not be remembered any more.
  void drop_old();

  /// Commands of this run have numbers from `first_number`.
  void begin_run(std::uint64_t first_number) { first_of_run_ = first_number; }
  /// Makes acknowledged commands in a file that opened late older than this run's.
  void age_earlier_runs();

  void load(SQLite::Database& database) override {
    table_.emplace(database);
    earlier_.reset();
  }
  void unload(Rows /*rows*/) override { table_.reset(); }
  bool has_pending() const override;
  void begin_commit() override;
  bool write_pending(std::size_t at_most) override;
  void committed() override;
  void move_waiting_times(std::int64_t by_ms) override;
  void move_stored_times(std::int64_t by_ms) override;

 private:
  struct Acknowledgement {
    std::string device;
    std::string id;
    std::uint64_t number = 0;
    std::string total_ms;
  };

  /// Within a commit: writes a command before it is carried out, or its result if it has one.
  /// Throws SQLite::Exception.
  void write(const JournalEntry& entry);
  /// Writes an entry that waits to UnrecordedFile.
  void keep(const JournalEntry& entry);
  /// Runs `work`, unless an earlier read of all devices has failed.
  void read(const std::string& device, const StoreDisk::Work& work);

  const StoreConfig config_;
  StoreDisk& disk_;
  AuditTrail& audit_;
  StartedCommands& started_;
  std::optional<CommandTable> table_;            ///< of the open file
  std::optional<EarlierCommands> earlier_;       ///< while no file has opened
  UnrecordedCommands waiting_;                   ///< commands and results not in the file yet
  UnrecordedFile unrecorded_file_;               ///< the same, for a restart
  std::vector<Acknowledgement> to_acknowledge_;  ///< acknowledged by the broker, not written yet
  std::size_t written_ = 0;                      ///< of waiting_, in the open commit
  bool is_acknowledged_ = false;                 ///< to_acknowledge_ is in the open commit
  std::size_t kept_ = 0;                         ///< of to_acknowledge_, in UnrecordedFile
  bool have_times_moved_ = false;                ///< since UnrecordedFile was up to date
  bool is_unread_ = false;                       ///< until take_unread()
  bool was_read_ = true;                         ///< see was_read()
  std::uint64_t first_of_run_ = 0;
  std::uint64_t not_to_be_shrunk_ = 0;  ///< bytes of commands that shrink() could not reduce
};

}  // namespace fxagent
