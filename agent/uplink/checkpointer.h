// Brings the write-ahead log of a SQLite file home into the file, on a thread and a connection of
// its own: that ends in synchronising the disk, milliseconds long and tenths of a second on an SD
// card, and live samples would wait for it.
#pragma once

#include <condition_variable>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>

#include "agent/uplink/sqlite.h"

namespace fxagent {

class Checkpointer final {
 public:
  /// Of the log, in pages of 4 KiB: from so many on it is brought home; where the disk is so slow
  /// that it grows to the second figure, the thread that writes does it and waits.
  static constexpr int kPages = 1000;
  static constexpr int kMostPages = 8000;

  /// Takes the place of the checkpoints at the commits of `writer`, an open database in WAL mode
  /// that outlives this; `path` is its file.
  Checkpointer(sqlite::Database& writer, const std::string& path);
  /// Waits for the end of a checkpoint. The thread of `writer`.
  ~Checkpointer();
  Checkpointer(const Checkpointer&) = delete;
  Checkpointer& operator=(const Checkpointer&) = delete;

 private:
  static int committed(void* self, sqlite3* writer, const char* schema, int pages);
  void run(std::stop_token stop);

  sqlite::Database& writer_;
  sqlite::Database own_;  ///< under working_
  std::mutex working_;
  std::mutex mutex_;
  std::condition_variable_any news_;
  bool due_ = false;  ///< under mutex_
  std::jthread thread_;
};

}  // namespace fxagent
