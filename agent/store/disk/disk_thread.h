// Runs disk work on its own thread, one piece at a time. The caller waits for a bounded time: a
// disk that hangs, as a frozen file system does, must not hold it up. One caller thread.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <stop_token>
#include <thread>

namespace fxagent {

class DiskThread final {
 public:
  using Work = std::function<void()>;

  static constexpr std::chrono::milliseconds kPatience{2000};

  /// Calls `ended` on the disk's thread when overdue work has ended. `ended` must not block or call
  /// this object. If no thread can be started, all work runs on the caller's.
  explicit DiskThread(Work ended);
  /// Waits until overdue work has ended.
  ~DiskThread();
  DiskThread(const DiskThread&) = delete;
  DiskThread& operator=(const DiskThread&) = delete;

  /// Sets the longest wait of run(); kPatience by default.
  void set_patience(std::chrono::milliseconds patience) { patience_ = patience; }
  /// Runs `work` and waits for it. Returns true when it has ended. Returns false if it is overdue:
  /// it continues, so everything it refers to must stay alive. Call only while is_busy() is false.
  bool run(Work work);
  /// True while overdue work is in progress.
  bool is_busy() const;

 private:
  void serve(const std::stop_token& stop);

  std::chrono::milliseconds patience_ = kPatience;
  const Work ended_;
  mutable std::mutex mutex_;
  std::condition_variable_any news_;
  Work work_;                ///< under mutex_; empty: no work
  bool is_overdue_ = false;  ///< under mutex_: run() stopped waiting for work_
  std::jthread thread_;
};

}  // namespace fxagent
