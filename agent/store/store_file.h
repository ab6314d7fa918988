// The store's directory, its lock, and the open file with its schema. What is kept in it and when
// is said in store.h. The store's thread.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>

#include "agent/store/checkpointer.h"
#include "agent/store/sqlite.h"

namespace fxagent {

/// Which file a name stands for; nothing where it stands for none.
struct FileIdentity {
  dev_t device = 0;
  ino_t number = 0;
  auto operator<=>(const FileIdentity&) const = default;
};
std::optional<FileIdentity> identity_of(const std::string& path);

/// Keeps a second agent away from a directory for as long as it lives, or until the process ends in
/// whatever way. The database's own lock would keep readers away too.
class DirectoryLock final {
 public:
  /// Waits a moment for a process that is just ending.
  explicit DirectoryLock(const std::string& directory);
  ~DirectoryLock();
  DirectoryLock(const DirectoryLock&) = delete;
  DirectoryLock& operator=(const DirectoryLock&) = delete;

  /// Empty: it is ours.
  const std::string& fault() const { return fault_; }
  /// Whether the lock file is still the one that was locked.
  bool is_in_place() const { return identity_ && identity_of(path_) == identity_; }

 private:
  std::string path_;
  std::optional<FileIdentity> identity_;
  int handle_ = -1;
  std::string fault_;
};

/// "fxagent.db" in `directory`.
std::string store_file_path(const std::string& directory);

/// Makes the directory (0700) where it is not there. Empty: done. One in which others could put
/// their own files is refused.
std::string make_store_directory(const std::string& directory);

/// The same, and the file (0600). One that is a link, or not ours, is refused.
std::string make_store_file(const std::string& directory);

/// Of an open file; empty: it is a plain one of our own, under one name.
std::string why_not_ours(int handle, const std::string& path);

class StoreFile final {
 public:
  /// Opens the file, or makes it, and brings its schema to the newest. `always`: every commit is
  /// synchronised with the disk. Throws SQLite::Exception.
  StoreFile(const std::string& path, bool always);

  /// Samples are synchronised with the disk even where commands are not: a power cut loses none
  /// that counts as stored. With `always` everything is.
  void synchronise(bool full);

  /// Nothing: there is room for a message more.
  std::optional<sqlite::Fault> why_not_writable();

  /// Whether the file and its log are still those that were opened: what is written to others that
  /// were deleted nobody finds again.
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
