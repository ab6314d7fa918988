// Commands of earlier runs in a store that cannot be opened for writing, as on a read-only file
// system: this run must not carry them out again. Only reads. Their results are published by a run
// that can record that. The store's thread.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/store/disk/sqlite.h"
#include "agent/store/journal/command_table.h"

namespace fxagent {

class EarlierCommands final {
 public:
  /// Opens the database in `directory` and reads UnrecordedFile. Logs a fault. Call only while no
  /// other process uses the directory.
  explicit EarlierCommands(const std::string& directory);
  EarlierCommands(const EarlierCommands&) = delete;
  EarlierCommands& operator=(const EarlierCommands&) = delete;

  /// Returns the ids of all commands, also of those without a result. `device` empty: of all
  /// devices. Logs a fault; the ids that it could not read are missing.
  std::vector<KnownId> known_ids(const std::string& device);
  /// Returns the entry of this id in the database.
  std::optional<JournalEntry> find(const std::string& device, const std::string& id);

 private:
  template <class Work>
  void read(Work&& work);

  const std::string path_;
  const std::vector<JournalEntry> unrecorded_;
  std::optional<SQLite::Database> database_;
  std::optional<CommandTable> table_;  ///< empty: nothing can be read
};

}  // namespace fxagent
