// A part of the store. Samples, journal, sequence numbers and audit share one file and its commits.
// StoreDisk calls these functions. The store's thread.
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
  /// Fate of the rows of a file that is closed.
  enum class Rows : std::uint8_t {
    kept,    ///< they stay in the file for the next run
    unread,  ///< the file could not be opened
    lost,    ///< gone with a damaged, deleted or replaced file
  };

  virtual ~StorePart() = default;

  /// Prepares the statements and reads the state that is kept in memory. Called when the file has
  /// opened. `database` stays valid until unload(). Throws SQLite::Exception.
  virtual void load(SQLite::Database& database) = 0;
  /// Finalizes the statements: SQLite does not close a file that still has some.
  virtual void unload(Rows rows) = 0;
  /// A damaged file was renamed to `name`; empty if it could not be renamed.
  virtual void set_aside(const std::string& /*name*/) {}
  /// A fresh file has replaced the damaged one.
  virtual void replaced() {}
  /// Samples in the file, for the log.
  virtual std::uint64_t rows() const { return 0; }

  /// True if write_pending() has something to write.
  virtual bool has_pending() const { return false; }

  // A commit is begin_commit(), the writes (write_pending() among them), end_commit(), and
  // committed() once the transaction is in the file. If it fails, committed() is not called, and
  // the next begin_commit() starts from the stored state. All except committed() throw
  // SQLite::Exception.
  virtual void begin_commit() {}
  /// Writes at most `at_most` of the entries that wait in memory. Returns true if more are left.
  virtual bool write_pending(std::size_t /*at_most*/) { return false; }
  virtual void end_commit() {}
  virtual void committed() {}
};

}  // namespace fxagent
