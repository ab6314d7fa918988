// The rows of commands in the store's file: journal, results and known ids, with their limits.
// Starts no transaction of its own. Every call may throw SQLite::Exception. The store's thread.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/store/disk/sqlite.h"

namespace fxagent {

class CommandTable final {
 public:
  /// `database` has the schema and outlives the table.
  explicit CommandTable(SQLite::Database& database);

  /// Call when a transaction has begun: bytes_in_commit() follows its changes. Without committed()
  /// the next begin() discards them.
  void begin() { changed_ = size_; }
  void committed() { size_ = changed_; }

  /// Writes a command before it is carried out. Replaces only an earlier command of the same id.
  void insert(const JournalEntry& entry);
  /// Writes a result. The first result of a command stays. Refused commands replace the oldest ones
  /// when there are too many.
  void record(const JournalEntry& entry);
  /// Marks the result as acknowledged, and sets its `total_ms`; empty if not known.
  void acknowledge(const std::string& device, const std::string& id, std::uint64_t number,
                   const std::string& total_ms);

  std::optional<JournalEntry> find(const std::string& device, const std::string& id);
  // As in CommandJournal. Empty `device`: all devices.
  std::vector<KnownId> known_ids(const std::string& device = {});
  std::vector<JournalEntry> unacknowledged(const std::string& device = {});

  /// Bytes of all rows, as committed.
  std::uint64_t bytes() const { return size_.bytes; }
  std::uint64_t bytes_in_commit() const { return changed_.bytes; }

  /// Deletes refused commands, then acknowledged results, oldest first, at most 200 a call. The ids
  /// of those results stay. Returns false if there was nothing to delete.
  bool shrink();
  /// Deletes what need not be remembered any more. Keeps an unacknowledged result for `max_age_ms`,
  /// at least 25 h, and at most kRememberedIds of them per device.
  void drop_old(std::int64_t utc_ms, std::int64_t max_age_ms);

  /// Shifts the times of commands that came from `from_ms` to `to_ms`, and of those that came
  /// earlier if they have a number from `from_number`.
  void move_times(std::int64_t by_ms, std::uint64_t from_number, std::int64_t from_ms,
                  std::int64_t to_ms);
  /// Makes acknowledged commands with a number from `from_number` older than all that follow.
  void age_acknowledged(std::uint64_t from_number);

 private:
  struct Size {
    std::uint64_t rows = 0;
    std::uint64_t bytes = 0;
    std::uint64_t refused = 0;
  };

  std::vector<KnownId> ids_where(const std::string& condition, const std::string& device);
  Size measure();
  Size size_of(const std::string& device, const std::string& id);
  void change(const std::string& device, const std::string& id, const std::function<void()>& work);
  void make_room_for_refused();

  SQLite::Database& database_;
  SQLite::Statement insert_;
  SQLite::Statement record_;
  SQLite::Statement find_;
  SQLite::Statement acknowledge_;
  SQLite::Statement cost_;          ///< of one row: its bytes, and 1 if it was refused
  SQLite::Statement drop_refused_;  ///< deletes the oldest; returns their bytes
  Size size_;                       ///< as committed
  /// Commands, results and acknowledgements since the last search for surplus rows.
  std::uint64_t changes_since_trim_ = 0;
  Size changed_;  ///< as the open transaction will leave it
};

}  // namespace fxagent
