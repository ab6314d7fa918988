// Runs the work of a disk on a thread of its own, one piece at a time. The caller waits for a
// bounded time: a disk that hangs, as a frozen file system does, must not hold up its caller.
// One caller thread.
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

  /// `ended` is called on this thread when overdue work has ended; it must not block. Without a
  /// thread all work runs in the caller's.
  explicit DiskThread(Work ended);
  /// Waits for the end of overdue work.
  ~DiskThread();
  DiskThread(const DiskThread&) = delete;
  DiskThread& operator=(const DiskThread&) = delete;

  /// run() waits for at most `patience`, kPatience until it is set.
  void set_patience(std::chrono::milliseconds patience) { patience_ = patience; }
  /// Runs `work` and waits for its end: true. False: the work is overdue and goes on, so all that
  /// it refers to must stay. Call only while is_busy() is false.
  bool run(Work work);
  /// True while overdue work goes on.
  bool is_busy() const;

 private:
  void serve(const std::stop_token& stop);

  std::chrono::milliseconds patience_ = kPatience;
  const Work ended_;
  mutable std::mutex mutex_;
  std::condition_variable_any news_;
  Work work_;                ///< under mutex_; empty: there is none
  bool is_overdue_ = false;  ///< under mutex_: run() did not wait for the end of work_
  std::jthread thread_;
};

}  // namespace fxagent
