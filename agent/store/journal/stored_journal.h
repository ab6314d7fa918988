// The journal of commands on disk: a CommandJournal. Entries that the disk refuses wait in
// JournalRows until it accepts them. The store's thread.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/store/audit_trail.h"
#include "agent/store/disk/store_disk.h"
#include "agent/store/journal/journal_rows.h"
#include "agent/store/journal/started_commands.h"

namespace fxagent {

class StoredJournal final : public CommandJournal {
 public:
  /// The referenced objects outlive it.
  StoredJournal(const StoreConfig& config, StoreDisk& disk, AuditTrail& audit,
                StartedCommands& started, JournalRows& rows)
      : config_(config), disk_(disk), audit_(audit), started_(started), rows_(rows) {}

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

  /// Returns every entry of which the disk has refused a part, as it stands in memory.
  std::vector<JournalEntry> unwritten();

  /// If commands take more than half of max_bytes, deletes refused ones, then acknowledged results,
  /// oldest first. Samples make room for the rest.
  void shrink();
  /// Deletes ids that need not be remembered any more.
  void drop_old();

  /// Commands of this run have numbers from `first_number`.
  void begin_run(std::uint64_t first_number) { first_of_run_ = first_number; }
  /// Makes acknowledged commands in a file that opened late older than this run's.
  void age_earlier_runs();
  /// Within a commit: shifts the times of this run's commands in the file. Throws
  /// SQLite::Exception.
  void move_stored_times(std::int64_t by_ms);

 private:
  const StoreConfig config_;
  StoreDisk& disk_;
  AuditTrail& audit_;
  StartedCommands& started_;
  JournalRows& rows_;
  std::uint64_t first_of_run_ = 0;
  std::uint64_t not_to_be_shrunk_ = 0;  ///< bytes of commands that shrink() could not reduce
};

}  // namespace fxagent
