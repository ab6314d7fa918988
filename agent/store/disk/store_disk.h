// The store's file, shared by its parts. Opens it, sets a damaged one aside, runs the commits,
// tracks whether the disk accepts writes, and detects that the calendar was set. Catches every
// fault of SQLite: the call returns false, and the state becomes `memory`. It stays `disk` after a
// failed read() of an intact file, and if a fresh file has replaced a damaged one. Opening, failing
// and committing belong together: a commit that finds damage opens a fresh file. The store's
// thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "agent/config/model.h"
#include "agent/steady_time.h"
#include "agent/store/disk/sqlite.h"
#include "agent/store/disk/store_file.h"

namespace fxagent {

/// A part of the store. Samples, journal, sequence numbers and audit share one file and its
/// commits. StoreDisk calls these functions.
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
  /// Writes what waits in memory, at most `at_most` new entries. Deletions and acknowledgements do
  /// not count. Returns true if entries are left.
  virtual bool write_pending(std::size_t /*at_most*/) { return false; }
  virtual void end_commit() {}
  virtual void committed() {}

  /// The calendar was set: shifts the times that this run has in memory.
  virtual void move_waiting_times(std::int64_t /*by_ms*/) {}
  /// Same in the file, within a commit. Times of commands that earlier runs have written since the
  /// machine started move too: they had the same clock. Throws SQLite::Exception.
  virtual void move_stored_times(std::int64_t /*by_ms*/) {}
};

class StoreDisk final {
 public:
  /// `full` synchronises a commit with the disk even if `sync: offline` would not. A power cut must
  /// not lose a sample that counts as stored.
  enum class Sync : std::uint8_t { as_configured, full };
  /// `logged`: each new reason why nothing can be written. `returned`: only last_failure() has it.
  enum class Failures : std::uint8_t { logged, returned };
  using Work = std::function<void()>;

  StoreDisk(const StoreConfig& config, std::int64_t utc_ms, Failures failures = Failures::logged)
      : config_(config), failures_(failures), utc_ms_(utc_ms) {}
  StoreDisk(const StoreDisk&) = delete;
  StoreDisk& operator=(const StoreDisk&) = delete;

  /// Sets the parts that share the file, in the order in which they load and write. Call before
  /// open(). They outlive every call here except the destructor's.
  void set_parts(std::vector<StorePart*> parts) { parts_ = std::move(parts); }
  bool has_pending() const { return std::ranges::any_of(parts_, &StorePart::has_pending); }
  /// Within a commit: calls write_pending() of each part. Returns true if one has entries left.
  /// Throws SQLite::Exception.
  bool write_pending(std::size_t at_most = std::numeric_limits<std::size_t>::max());

  /// Locks the directory, which it creates if necessary. Waits at most `patience` for a process
  /// that has the lock, by default for one that is just ending. Returns empty if the lock is ours,
  /// else the reason.
  std::string lock(std::chrono::milliseconds patience = kJustEnds);
  /// Locks the directory, then opens or creates the file. Sets a damaged file aside as
  /// fxagent.db.corrupt-<utc_ms>. On failure is_writable() is false; see last_failure().
  void open();
  /// Tests if an open file that refused writes accepts them again. Call only while is_open().
  void try_to_write();
  /// If the open files were deleted or replaced, closes them (contents lost) and returns true.
  bool abandon_misplaced();
  /// Clean end: copies the WAL into the file and closes it. The directory stays locked until this
  /// object ends: a second agent starts only when the first has written its other files, too.
  void close();

  bool is_open() const { return file_ != nullptr; }
  /// True while no other process can use the directory.
  bool is_locked() const { return lock_ != nullptr; }
  bool is_writable() const { return writable_; }
  /// Reason why the disk is not writable; empty while it is.
  const std::string& last_failure() const { return last_failure_; }
  /// True if the last lock() or open() failed because another process uses the directory.
  bool is_in_use() const { return is_in_use_; }
  /// True if this run has opened the file, or one whose place it takes. False after another process
  /// was found in the directory, or another file or lock file, which only another process creates.
  bool was_open() const { return was_open_; }
  /// Call only while is_open().
  SQLite::Database& database() { return file_->db; }
  /// Name of the damaged file that was set aside in this run; empty if there is none.
  const std::string& set_aside() const { return set_aside_; }

  /// Records the current time of both clocks. If the calendar moved by 60 s or more against the
  /// steady clock, it was set: shifts the times of this run by the same amount, those in memory at
  /// once. A gateway without a real-time clock starts in the past and gets its time over the same
  /// network as the broker, after the outage.
  void note_time(SteadyTime now, std::int64_t utc_ms);
  /// The time in ms UTC, as last recorded.
  std::int64_t utc_ms() const { return utc_ms_; }
  /// The time in ms UTC at which the machine started, by the same clock.
  std::int64_t machine_start_ms() const;
  /// True if times in the file still have to be shifted.
  bool has_times_to_move() const { return unmoved_ms_ != 0; }
  /// Shifts them in a commit, if any.
  void move_stored_times();

  /// Runs `work` in one transaction. False: nothing was kept. `doing` names the work in the log.
  bool commit(std::string_view doing, Sync sync, const Work& work);
  bool commit(std::string_view doing, const Work& work) {
    return commit(doing, Sync::as_configured, work);
  }
  /// Runs `work` on the open file without a transaction. Returns false if it failed.
  bool attempt(std::string_view doing, const Work& work);
  /// Same for reading a single row: after a failure the file stays writable unless it is damaged.
  bool read(const Work& work);

  /// Commits everything that waits in memory, at most 500 new entries of each part in one commit.
  /// Returns false if the disk did not accept all of it.
  bool flush();

 private:
  /// Calls this function of each part, with the same arguments.
  template <class... Parameters, class... Arguments>
  void each(void (StorePart::*function)(Parameters...), Arguments&&... arguments) {
    for (StorePart* part : parts_) (part->*function)(arguments...);
  }
  /// Samples of all parts.
  std::uint64_t rows() const;
  void let_go(StorePart::Rows rows);
  void start_anew(const std::string& why);
  void failed(std::string_view doing, const sqlite::Fault& fault);
  /// Enters the state `memory`. Logs a new reason if `failures_` says so.
  void refused(const std::string& why);

  const StoreConfig config_;
  const Failures failures_;
  std::vector<StorePart*> parts_;
  std::unique_ptr<DirectoryLock> lock_;
  std::unique_ptr<StoreFile> file_;  ///< null: not open
  bool writable_ = false;
  bool was_open_ = false;
  bool is_in_use_ = false;
  bool mending_ = false;  ///< a fresh file is replacing a damaged one
  std::string last_failure_;
  std::string set_aside_;
  std::int64_t utc_ms_;
  std::optional<SteadyTime> noted_at_;  ///< steady time of utc_ms_; nullopt before note_time()
  std::int64_t unmoved_ms_ = 0;         ///< shift that the file does not have yet
};

}  // namespace fxagent
