// The journal's rows in the store's file, and the entries that wait in memory until the disk
// accepts them. Each audit record is in the same commit as its entry. The store's thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/store/audit_trail.h"
#include "agent/store/disk/store_part.h"
#include "agent/store/journal/command_table.h"
#include "agent/store/journal/unrecorded_commands.h"

namespace fxagent {

class JournalRows final : public StorePart {
 public:
  /// `audit` outlives it.
  explicit JournalRows(AuditTrail& audit) : audit_(audit) {}

  /// The rows of the open file; null: none is open.
  CommandTable* table() { return table_ ? &*table_ : nullptr; }
  /// Bytes of commands in the file: as committed, and as the open commit will leave them.
  std::uint64_t bytes() const { return table_ ? table_->bytes() : 0; }
  std::uint64_t bytes_in_commit() const { return table_ ? table_->bytes_in_commit() : 0; }

  /// Within a commit: writes a command before it is carried out. Throws SQLite::Exception.
  void write_command(const JournalEntry& entry);
  /// Same for a result.
  void write_result(const JournalEntry& entry);
  /// Keeps the entry in memory until a commit writes it.
  void keep(JournalEntry entry);
  /// Same for an acknowledgement. It follows its result.
  void acknowledge(std::string device, std::string id, std::uint64_t number, std::string total_ms);
  /// Returns the entry of this id that waits in memory; null: none.
  const JournalEntry* waiting(const std::string& device, const std::string& id) const {
    return waiting_.find(device, id);
  }
  /// Every entry that waits.
  const UnrecordedCommands& waiting() const { return waiting_; }
  /// Device and id of every acknowledgement that waits.
  std::set<std::pair<std::string, std::string>> acknowledged_ids() const;
  /// Shifts the times in memory, after the calendar was set.
  void move_waiting_times(std::int64_t by_ms) { waiting_.move_times(by_ms); }

  void load(SQLite::Database& database) override { table_.emplace(database); }
  void unload(Rows /*rows*/) override { table_.reset(); }
  bool has_pending() const override;
  void begin_commit() override;
  bool write_pending(std::size_t at_most) override;
  void committed() override;

 private:
  struct Acknowledgement {
    std::string device;
    std::string id;
    std::uint64_t number = 0;
    std::string total_ms;
  };

  AuditTrail& audit_;
  std::optional<CommandTable> table_;            ///< of the open file
  UnrecordedCommands waiting_;                   ///< commands and results not in the file yet
  std::vector<Acknowledgement> to_acknowledge_;  ///< acknowledged by the broker, not written yet
  std::size_t written_ = 0;                      ///< of waiting_, in the open commit
  bool is_acknowledged_ = false;                 ///< to_acknowledge_ is in the open commit
};

}  // namespace fxagent
