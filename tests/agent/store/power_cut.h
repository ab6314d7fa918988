// A disk that forgets at a power cut, and that may freeze: SQLite's own files below a layer of
// SQLite's that counts what is synchronised, keeps a copy of each file as it was then, and has
// writes wait. So SQLite tests itself.
#pragma once

#include <sqlite3.h>

#include <condition_variable>
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

  /// Every write waits from now on, as on a frozen file system, until thaw().
  void freeze();
  void thaw();
  /// True while a write waits.
  bool is_awaited() const;

  /// For the layer: returns when the disk is not frozen.
  void await_thaw() const;
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
  mutable std::condition_variable thawed_;
  mutable int waiting_ = 0;
  bool is_frozen_ = false;
  std::map<std::string, File> files_;
};

/// The disk is frozen while this lives.
class Frost final {
 public:
  explicit Frost(PowerCut& disk) : disk_(disk) { disk_.freeze(); }
  ~Frost() { disk_.thaw(); }
  Frost(const Frost&) = delete;
  Frost& operator=(const Frost&) = delete;

 private:
  PowerCut& disk_;
};

}  // namespace fxagent::test
