// The disk below plain files, as power_cut.h is below SQLite's. After a power cut, each file has
// the content of its last fsync(), and the directory has the names of its last fsync(). A file that
// was never synced is empty.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <tuple>

namespace fxagent::test {

/// Records every fsync() of the program during its own lifetime. One at a time.
class SyncedFiles final {
 public:
  SyncedFiles();
  ~SyncedFiles();
  SyncedFiles(const SyncedFiles&) = delete;
  SyncedFiles& operator=(const SyncedFiles&) = delete;

  /// Creates `directory` with the plain files of `from` whose names begin with `prefix`, as they
  /// are after a power cut at this moment.
  void leave(const std::string& from, const std::string& directory,
             const std::string& prefix = {}) const;

  /// Called by fsync().
  void synchronised(int handle);

 private:
  /// Device, inode and birth time, because inodes are reused.
  using Identity = std::tuple<std::uint64_t, std::uint64_t, std::int64_t>;
  static Identity identity_of(int directory, const char* name);

  mutable std::mutex mutex_;
  std::map<Identity, std::string> contents_;
  std::map<Identity, std::map<std::string, Identity>> names_;  ///< by directory
};

}  // namespace fxagent::test
