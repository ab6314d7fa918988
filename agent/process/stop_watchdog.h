// Watchdog of the shutdown. Waits for a stop signal on a separate thread, and ends the process by
// force if the agent has not ended some seconds later. A wait in a library, a disk or a driver
// cannot block it.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "agent/file_handle.h"

namespace fxagent {

class StopWatchdog final {
 public:
  /// A stop that takes longer is ended by force.
  static constexpr std::chrono::seconds kPatience{9};
  /// Time to free resources when everything has been reported and written.
  static constexpr std::chrono::seconds kFreeing{1};
  /// Exit status of a process that was ended by force before everything was reported and written.
  static constexpr int kEndedByForce = 1;

  /// Blocks SIGINT and SIGTERM in this thread and in those that it starts, and starts the
  /// watchdog's thread. It leaves a stop signal pending: if this program replaces itself at that
  /// moment, the new one receives the signal. Throws std::system_error without a free file handle
  /// or thread.
  StopWatchdog();
  /// Stops the watchdog: the process has practically ended.
  ~StopWatchdog();
  StopWatchdog(const StopWatchdog&) = delete;
  StopWatchdog& operator=(const StopWatchdog&) = delete;

  /// After this call a stop is orderly; before it, a stop signal ends the process at once with exit
  /// status 0. `what` is as in stage(). Main thread.
  void begin(const char* what);
  /// Waits for a stop signal and returns its number; nullopt: none came before `deadline`.
  /// time_point::max(): waits without a limit.
  std::optional<int> await_signal(std::chrono::steady_clock::time_point deadline);

  /// True if a stop signal has come. Any thread.
  bool has_signal();

  /// Sets what the agent is waiting for; the line of a forced end reports it. `what` is a literal.
  /// `more` returns details. It runs on the watchdog's thread and must not call this object, and
  /// what it refers to outlives the stage. Main thread.
  void stage(const char* what, std::function<std::string()> more = {});
  /// Call when everything has been reported and written. If the rest hangs, the watchdog ends the
  /// process with exit status 0 after at most kFreeing. Main thread.
  void nothing_left_to_lose();

 private:
  void run();
  void end_by_force(int status);

  const FileHandle signals_;  ///< readable while a stop signal is pending
  std::mutex mutex_;
  std::condition_variable news_;
  int signal_ = 0;                       ///< under mutex_; 0: none so far
  bool begun_ = false;                   ///< under mutex_
  bool over_ = false;                    ///< under mutex_
  bool freeing_ = false;                 ///< under mutex_
  const char* what_ = "";                ///< under mutex_
  std::function<std::string()> more_{};  ///< under mutex_
  std::thread thread_;
};

}  // namespace fxagent
