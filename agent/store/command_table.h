// The rows of commands in the store's file: their journal, their results and what is kept of ids,
// and the limits of these. It has no transactions of its own but those of SQLite for a single
// statement. Every call may throw SQLite::Exception. The store's thread.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/store/sqlite.h"

namespace fxagent {

class CommandTable final {
 public:
  /// `database` has the schema and outlives the table.
  explicit CommandTable(SQLite::Database& database);

  /// A transaction has begun: bytes_in_commit() follows its changes. Without committed() they are
  /// forgotten at the next begin().
  void begin() { changed_ = size_; }
  void committed() { size_ = changed_; }

  /// A command before it is carried out. A row makes room for a later command only.
  void insert(const JournalEntry& entry);
  /// A result. The first one of a command stays; of refused commands the oldest make room.
  void record(const JournalEntry& entry);
  /// `total_ms` goes into the result; empty: it is not known.
  void acknowledge(const std::string& device, const std::string& id, std::uint64_t number,
                   const std::string& total_ms);

  std::optional<JournalEntry> find(const std::string& device, const std::string& id);
  // As CommandJournal has them; `device` empty: of all.
  std::vector<KnownId> known_ids(const std::string& device = {});
  std::vector<JournalEntry> unacknowledged(const std::string& device = {});

  /// What the rows take, as it was committed.
  std::uint64_t bytes() const { return size_.bytes; }
  std::uint64_t bytes_in_commit() const { return changed_.bytes; }

  /// Lets refused commands go, then results that were acknowledged, oldest first, some at a time;
  /// their ids stay. False: there is none.
  bool shrink();
  /// Lets go what need not be remembered any more. `max_age_ms`: how long a result that nobody has
  /// acknowledged is kept.
  void drop_old(std::int64_t utc_ms, std::int64_t max_age_ms);

  /// Moves the times of the commands from this number on that came up to `received_ms`.
  void move_times(std::int64_t by_ms, std::uint64_t from_number, std::int64_t received_ms);
  /// What is acknowledged and has a number from this one on counts as older than all that follows.
  void age_acknowledged(std::uint64_t from_number);

 private:
  struct Size {
    std::uint64_t rows = 0;
    std::uint64_t bytes = 0;
    std::uint64_t refused = 0;
  };

  Size measure();
  Size size_of(const std::string& device, const std::string& id);
  void change(const std::string& device, const std::string& id, const std::function<void()>& work);
  void make_room_for_refused();

  SQLite::Database& database_;
  SQLite::Statement insert_;
  SQLite::Statement record_;
  SQLite::Statement acknowledge_;
  SQLite::Statement cost_;          ///< of one: its bytes, and whether it was refused
  SQLite::Statement drop_refused_;  ///< the oldest of them; their bytes
  Size size_;                       ///< as committed
  /// Since what is one too many was last looked for: commands, results and acknowledgements.
  std::uint64_t changes_since_trim_ = 0;
  Size changed_;  ///< as the transaction that is open will leave it
};

}  // namespace fxagent
