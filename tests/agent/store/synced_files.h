// The disk below plain files, as power_cut.h is below SQLite's: what a power cut leaves of a
// directory. Of each file the content of its last fsync() is there, and the names are those of the
// last fsync() of the directory. A file that was never synchronised is empty.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <tuple>

namespace fxagent::test {

/// Records every fsync() of the program while it lives. One at a time.
class SyncedFiles final {
 public:
  SyncedFiles();
  ~SyncedFiles();
  SyncedFiles(const SyncedFiles&) = delete;
  SyncedFiles& operator=(const SyncedFiles&) = delete;

  /// Makes `directory` with what a power cut at this moment leaves of the plain files of `from`
  /// whose names begin with `prefix`.
  void leave(const std::string& from, const std::string& directory,
             const std::string& prefix = {}) const;

  /// For fsync().
  void synchronised(int handle);

 private:
  /// Device, inode and birth time: an inode is used anew.
  using Identity = std::tuple<std::uint64_t, std::uint64_t, std::int64_t>;
  static Identity identity_of(int directory, const char* name);

  mutable std::mutex mutex_;
  std::map<Identity, std::string> contents_;
  std::map<Identity, std::map<std::string, Identity>> names_;  ///< by directory
};

}  // namespace fxagent::test
