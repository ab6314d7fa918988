// The parts of the store. Samples, journal, sequence numbers and audit share one file and its
// commits. StoreDisk calls these functions. The store's thread.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

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

/// The parts, in their order.
class StoreParts final {
 public:
  /// Sets the parts, in the order in which they load and write. They outlive every call here.
  void set(std::vector<StorePart*> parts) { parts_ = std::move(parts); }
  /// Calls this function of each part, with the same arguments.
  template <class... Parameters, class... Arguments>
  void each(void (StorePart::*function)(Parameters...), Arguments&&... arguments) {
    for (StorePart* part : parts_) (part->*function)(arguments...);
  }
  /// Samples of all parts.
  std::uint64_t rows() const {
    std::uint64_t rows = 0;
    for (const StorePart* part : parts_) rows += part->rows();
    return rows;
  }
  bool has_pending() const { return std::ranges::any_of(parts_, &StorePart::has_pending); }
  /// Writes at most `at_most` entries of each part. Returns true if more are left.
  bool write_pending(std::size_t at_most = std::numeric_limits<std::size_t>::max()) {
    bool is_left = false;
    for (StorePart* part : parts_) is_left = part->write_pending(at_most) || is_left;
    return is_left;
  }

 private:
  std::vector<StorePart*> parts_;
};

}  // namespace fxagent
