// A disk that loses unsynced data at a power cut and that can freeze. It is a VFS layer below
// SQLite that counts syncs, keeps a copy of each file as of its last sync, and can block writes.
// SQLite tests itself in this way.
#pragma once

#include <sqlite3.h>

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace fxagent::test {

/// While this object lives, every database opened is on such a disk. One at a time.
class PowerCut final {
 public:
  PowerCut();
  ~PowerCut();
  PowerCut(const PowerCut&) = delete;
  PowerCut& operator=(const PowerCut&) = delete;

  /// The number of syncs of files whose name ends with `ending`.
  std::uint64_t syncs(const std::string& ending) const;
  /// Creates `directory` with the content of `from` after a power cut at this moment: each database
  /// file as of its last sync, and no file that was never synced.
  void leave(const std::string& from, const std::string& directory) const;

  /// Blocks every write until thaw(), as a frozen file system does.
  void freeze();
  void thaw();
  /// Lets every read and commit fail while true, as a bad cable does. The file stays whole.
  void set_failing(bool fails) { is_failing_ = fails; }
  bool is_failing() const { return is_failing_; }
  /// True while a write is blocked.
  bool is_awaited() const;

  /// Called by the layer: returns when the disk is not frozen.
  void await_thaw() const;
  /// Called by the layer: these bytes of the file were written or cut off.
  void changed(const std::string& path, std::int64_t begin, std::int64_t end);
  /// Copies part of a file. Returns false if it cannot be read.
  using Copy = std::function<bool(char* into, std::int64_t at, std::int64_t count)>;
  /// Called by the layer: the file, now `size` bytes long, is on the disk. Returns false if its
  /// changed parts cannot be read.
  bool synchronised(const std::string& path, std::int64_t size, const Copy& copy);
  /// Called by the layer: the file was deleted.
  void deleted(const std::string& path);

 private:
  struct File {
    std::string content;  ///< as of the last sync
    std::uint64_t syncs = 0;
    std::vector<std::pair<std::int64_t, std::int64_t>> changed;  ///< since then: begin and end
  };
  mutable std::mutex mutex_;
  mutable std::condition_variable thawed_;
  mutable int waiting_ = 0;
  bool is_frozen_ = false;
  std::atomic<bool> is_failing_ = false;
  std::map<std::string, File> files_;
};

/// Freezes the disk during its own lifetime.
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
