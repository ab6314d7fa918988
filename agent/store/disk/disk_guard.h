// Runs the store's work on the disk's thread and waits for it at most 2 s. Work that takes longer
// is overdue, and the store hangs: nothing else may touch the store until the work has ended.
//
// Uplink thread; before that thread starts, the thread that made it.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "agent/store/disk/disk_thread.h"

namespace fxagent {

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
