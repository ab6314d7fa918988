// A disk that forgets at a power cut: SQLite's own files below a layer of SQLite's that counts what
// is synchronised and keeps a copy of each file as it was then. So SQLite tests itself.
#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <map>
#include <mutex>
#include <string>

namespace fxagent::test {

/// While it lives, every database that is opened lies on such a disk. One at a time.
class PowerCut final {
 public:
  PowerCut();
  ~PowerCut();
  PowerCut(const PowerCut&) = delete;
  PowerCut& operator=(const PowerCut&) = delete;

  /// Of files whose name ends so: how often they were synchronised.
  std::uint64_t syncs(const std::string& ending) const;
  /// Makes `directory` with what a power cut at this moment leaves of `from`: of each database file
  /// what was synchronised last, and nothing of one that never was.
  void leave(const std::string& from, const std::string& directory) const;

  /// For the layer: this file is on the disk as it is now.
  void synchronised(const std::string& path, std::string content);
  /// For the layer: the file is no more.
  void deleted(const std::string& path);

 private:
  struct File {
    std::string content;
    std::uint64_t syncs = 0;
  };
  mutable std::mutex mutex_;
  std::map<std::string, File> files_;
};

}  // namespace fxagent::test
