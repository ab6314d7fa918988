// Runs the store's work on the disk's thread and waits for it at most 2 s: a disk that hangs, as a
// frozen file system does, must not hold up the caller. Work that takes longer is overdue, and the
// store hangs: nothing else may touch the store until the work has ended.
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

class DiskGuard final {
 public:
  using Work = std::function<void()>;

  static constexpr std::chrono::milliseconds kPatience{2000};

  /// `path` is the store's directory, for the log. Calls `before` ahead of each work: it copies the
  /// figures that must be known while the store hangs. Calls `wake` on the disk's thread when
  /// overdue work has ended; it must not block or call this object. Throws std::system_error if no
  /// thread can be started.
  DiskGuard(std::string path, Work before, Work wake);
  /// Waits until overdue work has ended.
  ~DiskGuard() = default;
  DiskGuard(const DiskGuard&) = delete;
  DiskGuard& operator=(const DiskGuard&) = delete;

  /// Sets the longest wait of run(); kPatience by default.
  void set_patience(std::chrono::milliseconds patience) { patience_ = patience; }

  /// True from the time when work became overdue until resume().
  bool hangs() const { return hangs_; }
  /// Runs `work` and waits for it. Returns false if it is overdue: it continues, so everything it
  /// refers to must stay alive; resume() then calls `late`. Call only while hangs() is false.
  bool run(Work work, Work late = {});
  /// Returns the answer, or an empty one if the store hangs or the question is overdue.
  template <class Result>
  Result ask(std::function<Result()> question) {
    if (hangs_) return {};
    const auto answer = std::make_shared<Result>();
    if (!run([answer, question = std::move(question)] { *answer = question(); })) return {};
    return std::move(*answer);
  }
  /// True if the overdue work has ended.
  bool has_answered() const;
  /// Ends the hang, once has_answered(). `state` is the store's, for the log.
  void resume(std::string_view state);

 private:
  void serve(const std::stop_token& stop);

  const std::string path_;
  const Work before_;
  const Work wake_;
  std::chrono::milliseconds patience_ = kPatience;
  Work late_;  ///< called when the overdue work has ended
  mutable std::mutex mutex_;
  std::condition_variable_any news_;
  Work work_;           ///< under mutex_; empty: no work
  bool hangs_ = false;  ///< set under mutex_ while there is work: run() stopped waiting for it
  std::jthread thread_;
};

}  // namespace fxagent
