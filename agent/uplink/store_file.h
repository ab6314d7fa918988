// The open file of the store: its schema, its lock, and its statements, prepared once. What is kept
// in it and when is store.h's. The store's thread.
#pragma once

#include <optional>
#include <string>

#include "agent/uplink/audit_trail.h"
#include "agent/uplink/checkpointer.h"
#include "agent/uplink/sqlite.h"

namespace fxagent {

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

 private:
  int handle_ = -1;
  std::string fault_;
};

/// "fxagent.db" in `directory`.
std::string store_file_path(const std::string& directory);

/// Makes the directory (0700) and the file (0600) where they are not there. Empty: done.
std::string make_store_file(const std::string& directory);

class StoreFile final {
 public:
  /// `always`: every commit is synchronised with the disk.
  StoreFile(const std::string& path, bool always);

  /// Whether the schema is there; else db.fault() says why not.
  bool is_usable() const { return usable_; }

  /// Samples are synchronised with the disk even where orders are not: a power cut loses none that
  /// counts as stored. With `always` everything is.
  void synchronise(bool full);

  /// Whether there is room for a message more.
  bool can_write();

  sqlite::Database db;
  sqlite::Statement insert;
  sqlite::Statement remove;
  sqlite::Statement lane;
  sqlite::Statement oldest;
  sqlite::Statement order;
  sqlite::Statement record;
  sqlite::Statement told;
  sqlite::Statement numbers;
  AuditTrail trail;

 private:
  const bool always_;
  bool usable_ = false;
  std::optional<Checkpointer> checkpointer_;
};

}  // namespace fxagent
