// Runs WAL checkpoints of a SQLite file on its own thread and connection. A checkpoint synchronises
// the disk. That takes milliseconds, on an SD card tenths of a second, for which live samples would
// wait.
#pragma once

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>

#include "agent/store/disk/sqlite.h"

namespace fxagent {

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

}  // namespace fxagent
