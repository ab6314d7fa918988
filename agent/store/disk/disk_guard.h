// Runs the store's work on the disk's thread and waits for it at most 2 s. Work that takes longer
// is overdue, and the store hangs: nothing else may touch the store until the work has ended.
//
// Uplink thread; before that thread starts, the thread that made it.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

namespace fxagent {

/// Runs disk work on its own thread, one piece at a time. The caller waits for a bounded time: a
/// disk that hangs, as a frozen file system does, must not hold it up. One caller thread.
class DiskThread final {
 public:
  using Work = std::function<void()>;

  static constexpr std::chrono::milliseconds kPatience{2000};

  /// Calls `ended` on the disk's thread when overdue work has ended. `ended` must not block or call
  /// this object. If no thread can be started, all work runs on the caller's.
  explicit DiskThread(Work ended);
  /// Waits until overdue work has ended.
  ~DiskThread() = default;
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

class DiskGuard final {
 public:
  using Work = DiskThread::Work;

  /// `path` is the store's directory, for the log. Calls `before` ahead of each work: it copies the
  /// figures that must be known while the store hangs. Calls `wake` on the disk's thread when
  /// overdue work has ended.
  DiskGuard(std::string path, std::function<void()> before, std::function<void()> wake)
      : path_(std::move(path)), before_(std::move(before)), thread_(std::move(wake)) {}
  void set_patience(std::chrono::milliseconds patience) { thread_.set_patience(patience); }

  /// True from the time when work became overdue until resume().
  bool hangs() const { return hangs_; }
  /// Returns false if the work is overdue; resume() then calls `late`. Call only while hangs() is
  /// false.
  bool run(Work work, std::function<void()> late = {});
  /// Returns the answer, or an empty one if the store hangs or the question is overdue.
  template <class Result>
  Result ask(std::function<Result()> question) {
    if (hangs_) return {};
    const auto answer = std::make_shared<Result>();
    if (!run([answer, question = std::move(question)] { *answer = question(); })) return {};
    return std::move(*answer);
  }
  /// True if the overdue work has ended.
  bool has_answered() const { return hangs_ && !thread_.is_busy(); }
  /// Ends the hang, once has_answered(). `state` is the store's, for the log.
  void resume(std::string_view state);

 private:
  const std::string path_;
  const std::function<void()> before_;
  bool hangs_ = false;
  std::function<void()> late_;  ///< called when the overdue work has ended
  DiskThread thread_;
};

}  // namespace fxagent
