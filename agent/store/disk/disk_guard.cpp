#include "agent/store/disk/disk_guard.h"

#include "agent/log/log.h"
#include "agent/without_signals.h"

namespace fxagent {

DiskGuard::DiskGuard(std::string path, Work before, Work wake)
    : path_(std::move(path)), before_(std::move(before)), wake_(std::move(wake)) {
  const WithoutSignals quiet;
  thread_ = std::jthread([this](const std::stop_token& stop) { serve(stop); });
}

bool DiskGuard::run(Work work, Work late) {
  before_();
  {
    std::unique_lock lock(mutex_);
    work_ = std::move(work);
    news_.notify_all();
    hangs_ = !news_.wait_for(lock, patience_, [this] { return !work_; });
  }
  if (!hangs_) return true;
  late_ = std::move(late);
  log::error("store", {{"state", "hangs"},
                       {"path", path_},
                       {"note",
                        "the disk does not respond: until it does, samples wait in memory and the "
                        "agent refuses commands that write"}});
  return false;
}

void DiskGuard::serve(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (news_.wait(lock, stop, [this] { return static_cast<bool>(work_); })) {
    const Work& work = work_;
    lock.unlock();
    work();
    lock.lock();
    work_ = nullptr;
    news_.notify_all();
    if (hangs_) wake_();
  }
}

bool DiskGuard::has_answered() const {
  const std::lock_guard lock(mutex_);
  return hangs_ && !work_;
}

void DiskGuard::resume(std::string_view state) {
  hangs_ = false;
  log::info("store", {{"state", std::string(state)}, {"note", "the disk responds again"}});
  if (const auto late = std::exchange(late_, {})) late();
}

}  // namespace fxagent
