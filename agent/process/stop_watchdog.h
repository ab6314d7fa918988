// Watchdog of the end: waits for SIGTERM on a thread of its own, and ends the process by force
// where the agent has not ended some seconds later. No wait of a library, a disk or a driver can
// hold it.
#pragma once

#include <chrono>
#include <condition_variable>
#include <csignal>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

namespace fxagent {

class StopWatchdog final {
 public:
  /// A stop that takes longer is ended by force.
  static constexpr std::chrono::seconds kPatience{9};
  /// What is left to be freed when all is said and written has so long.
  static constexpr std::chrono::seconds kFreeing{1};
  /// Exit status of a process that was ended by force before all was said and written.
  static constexpr int kEndedByForce = 1;

  /// Starts the thread. `stop_signals` are blocked in every thread of the process. Throws
  /// std::system_error where there is no thread.
  explicit StopWatchdog(const sigset_t& stop_signals);
  /// The process is as good as ended: the watchdog goes to sleep.
  ~StopWatchdog();
  StopWatchdog(const StopWatchdog&) = delete;
  StopWatchdog& operator=(const StopWatchdog&) = delete;

  /// From here on there is something to end in order. Until then a stop signal ends the process at
  /// once, with exit status 0. Main thread.
  void begin(const char* what);
  /// Waits for a stop signal; its number.
  int await_signal();
  /// The same, for so long at the most; nothing: none came.
  std::optional<int> await_signal(std::chrono::nanoseconds patience);

  /// What the agent waits for from now on, for the line that names it. `more` is asked for details
  /// on the watchdog's thread and must outlive the stage. Main thread.
  void stage(const char* what, std::function<std::string()> more = {});
  /// Everything is said and written, so that what does not end from now on does no harm: it is left
  /// behind with exit status 0. Main thread.
  void nothing_left_to_lose();

 private:
  void run(const sigset_t& stop_signals);
  void end_by_force(int status);

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
