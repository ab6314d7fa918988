// The store's directory, its lock, and the open file with its schema and its checkpoints. store.h
// describes the contents. The store's thread.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>

#include "agent/file_handle.h"
#include "agent/store/disk/sqlite.h"

namespace fxagent {

/// Device and inode of a file. identity_of() does not follow a link; it returns nullopt if there is
/// no file at `path`, or the handle is not open.
struct FileIdentity {
  dev_t device = 0;
  ino_t number = 0;
  auto operator<=>(const FileIdentity&) const = default;
};
std::optional<FileIdentity> identity_of(const std::string& path);
std::optional<FileIdentity> identity_of(int handle);

/// Keeps a second agent away from a directory. The lock ends with this object, or with the process,
/// however that ends. A lock on the database itself would keep readers away too.
class DirectoryLock final {
 public:
  /// Waits at most `patience` for a process that has the lock. On a read-only file system it locks
  /// the file of an earlier run.
  DirectoryLock(const std::string& directory, std::chrono::milliseconds patience);
  DirectoryLock(const DirectoryLock&) = delete;
  DirectoryLock& operator=(const DirectoryLock&) = delete;

  /// Empty if the lock is ours, else the reason.
  const std::string& fault() const { return fault_; }
  /// True if another process has the lock.
  bool is_in_use() const { return is_in_use_; }
  /// True if the lock file is still the one that was locked.
  bool is_in_place() const { return identity_of(path_) == identity_of(handle_); }
  /// True if another lock file has its place: another process has used the directory.
  bool is_replaced() const { return identity_of(path_) && !is_in_place(); }

 private:
  std::string path_;
  FileHandle handle_;
  std::string fault_;
  bool is_in_use_ = false;
};

/// Returns "WHAT: " and the reason that errno has.
std::string fault_of_system(const std::string& what);

/// Returns false, with errno set, if part of `data` was not written.
bool write_at(int handle, const void* data, std::size_t size, std::size_t at);

/// Patience for the lock of a process that is just ending.
inline constexpr std::chrono::milliseconds kJustEnds{500};

/// Locks the open file or directory against other processes. Waits at most `patience` for a process
/// that has the lock. Returns false, with errno set, if the lock is not ours; EWOULDBLOCK: another
/// process has it.
bool lock_within(int handle, std::chrono::milliseconds patience);

/// Returns that a running fxagent, by its process id if it can be found, has locked `locked`, which
/// is the directory or a file in it, and what to do.
std::string in_use(const std::string& directory, const std::string& locked);

/// Returns in_use() if another process has the DirectoryLock of a directory that
/// make_store_directory() refuses, and keeps it for `patience`. Else returns empty. Creates
/// nothing.
std::string refused_in_use(const std::string& directory, std::chrono::milliseconds patience);

/// Returns the path of "fxagent.db" in `directory`.
std::string store_file_path(const std::string& directory);

/// Creates the directory (0700) if it does not exist. Refuses a directory in which another user
/// could replace the store's files: one of another user, except root's, and one that group or
/// others may write, unless it is sticky. Returns empty on success, else the reason.
std::string make_store_directory(const std::string& directory);

/// Same, and creates the file (0600). Refuses a link and a file of another user.
std::string make_store_file(const std::string& directory);

/// Returns empty if the open file is plain, of our own user and has one name, else the reason.
std::string why_not_ours(int handle, const std::string& path);

/// Opens a file only to read it. The handle is not open if there is no file, or why_not_ours() has
/// a reason.
FileHandle open_to_read(const std::string& path);

/// Runs WAL checkpoints of a SQLite file on its own thread and connection. A checkpoint
/// synchronises the disk. That takes milliseconds, on an SD card tenths of a second, for which live
/// samples would wait.
class Checkpointer final {
 public:
  /// WAL pages of 4 KiB. A checkpoint starts when kPages of them are not in the database yet.
  /// Constant commits can keep it from finishing and the WAL from starting over; from kMostPages
  /// on, the writing thread copies the rest and waits.
  static constexpr int kPages = 1000;
  static constexpr int kMostPages = 8000;

  /// Replaces the checkpoints at the commits of `writer`, an open database in WAL mode that
  /// outlives this; `path` is its file. Throws std::system_error if no thread can be started, and
  /// SQLite::Exception if the file does not open a second time.
  Checkpointer(SQLite::Database& writer, const std::string& path);
  /// Waits for a running checkpoint. Call on the thread of `writer`.
  ~Checkpointer();
  Checkpointer(const Checkpointer&) = delete;
  Checkpointer& operator=(const Checkpointer&) = delete;

 private:
  static int committed(void* self, sqlite3* writer, const char* schema, int pages) noexcept;
  void run(const std::stop_token& stop);
  void bring_home();

  SQLite::Database& writer_;
  SQLite::Database own_;         ///< under working_
  std::atomic<int> copied_ = 0;  ///< WAL pages that are in the database
  std::mutex working_;
  std::mutex mutex_;
  std::condition_variable_any news_;
  bool due_ = false;  ///< under mutex_
  std::jthread thread_;
};

class StoreFile final {
 public:
  /// Opens or creates the file and brings its schema to the newest version. `always`: every commit
  /// is synchronised with the disk. Throws SQLite::Exception.
  StoreFile(const std::string& path, bool always);

  /// Turns synchronisation with the disk on or off for the commits that follow. Samples need it
  /// even if commands do not: a power cut must not lose a sample that counts as stored. With
  /// `always` it stays on.
  void synchronise(bool full);

  /// Writes and deletes a row of 64 KiB. Returns the fault, or nullopt if the file accepts writes.
  std::optional<sqlite::Fault> why_not_writable();

  /// True if the file is still the one that was opened. A deleted file still accepts writes, but no
  /// later run finds them.
  bool has_its_name() const { return file_ && identity_of(path_) == file_; }
  /// True if the file and its WAL are.
  bool is_in_place() const;

  SQLite::Database db;

 private:
  const std::string path_;
  const bool always_;
  std::optional<FileIdentity> file_;
  std::optional<FileIdentity> log_;
  std::optional<Checkpointer> checkpointer_;
};

}  // namespace fxagent
