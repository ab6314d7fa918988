// Runs WAL checkpoints of a SQLite file on a thread and a connection of its own: a checkpoint ends
// in synchronising the disk, milliseconds long and tenths of a second on an SD card, and live
// samples would wait for it.
#pragma once

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>

#include "agent/store/sqlite.h"

namespace fxagent {

class Checkpointer final {
 public:
  /// Of the WAL, in pages of 4 KiB: a checkpoint begins when so many are not in the file. Where it
  /// never comes to an end, and the WAL never begins anew, since there is always one commit more,
  /// the thread that writes copies the rest and waits; from the second figure on.
  static constexpr int kPages = 1000;
  static constexpr int kMostPages = 8000;

  /// Takes the place of the checkpoints at the commits of `writer`, an open database in WAL mode
  /// that outlives this; `path` is its file. Throws std::system_error where there is no thread,
  /// and SQLite::Exception where the file does not open a second time.
  Checkpointer(SQLite::Database& writer, const std::string& path);
  /// Waits for the end of a checkpoint. The thread of `writer`.
  ~Checkpointer();
  Checkpointer(const Checkpointer&) = delete;
  Checkpointer& operator=(const Checkpointer&) = delete;

 private:
  std::jthread started();
  static int committed(void* self, sqlite3* writer, const char* schema, int pages) noexcept;
  void run(std::stop_token stop);
  void bring_home();

  SQLite::Database& writer_;
  SQLite::Database own_;         ///< under working_
  std::atomic<int> copied_ = 0;  ///< pages of the log that are in the database
  std::mutex working_;
  std::mutex mutex_;
  std::condition_variable_any news_;
  bool due_ = false;  ///< under mutex_
  std::jthread thread_;
};

}  // namespace fxagent
