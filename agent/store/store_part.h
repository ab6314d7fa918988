// What the parts of the store have in common: samples, the journal, numbers and the audit lie in
// one file and go into the same commits. store_disk.h calls these. The store's thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace SQLite {
class Database;
}

namespace fxagent {

class StorePart {
 public:
  /// What has become of the rows of a file that is closed.
  enum class Rows : std::uint8_t {
    kept,    ///< they are in the file, for the next run
    unread,  ///< the file could not be opened
    lost,    ///< they were this run's, and nobody will find them
  };

  virtual ~StorePart() = default;

  /// The file has opened: prepares the statements and reads what is kept in memory of it.
  /// `database` stays until unload(). Throws SQLite::Exception.
  virtual void load(SQLite::Database& database) = 0;
  /// Finalizes the statements: SQLite does not close a file that has any.
  virtual void unload(Rows rows) = 0;
  /// A damaged file was set aside under this name; empty: it could not be renamed.
  virtual void set_aside(const std::string& /*name*/) {}
  /// A fresh file has taken the place of the damaged one.
  virtual void replaced() {}
  /// Samples in the file, for the log.
  virtual std::uint64_t rows() const { return 0; }

  /// Whether write_pending() has something to write.
  virtual bool has_pending() const { return false; }

  // A commit: begin_commit(), then what is to be written, perhaps with write_pending(), then
  // end_commit(); committed() once it is in the file. Without that the next begin_commit() starts
  // from what is there. All but the last throw SQLite::Exception.
  virtual void begin_commit() {}
  /// Writes what waits in memory, at most so many entries. Returns whether more are left.
  virtual bool write_pending(std::size_t /*at_most*/) { return false; }
  virtual void end_commit() {}
  virtual void committed() {}
};

}  // namespace fxagent
