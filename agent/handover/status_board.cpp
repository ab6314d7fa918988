#include "agent/handover/status_board.h"

namespace fxagent {

std::shared_ptr<const AgentStatus> StatusBoard::read(SteadyTime now,
                                                     std::chrono::milliseconds patience) {
  std::unique_lock lock(mutex_);
  if (newest_ && now - newest_at_ < kFresh) return newest_;
  const auto old = newest_;
  if (!asked_.exchange(true)) {
    lock.unlock();
    wake_();
    lock.lock();
  }
  published_.wait_for(lock, patience, [&] { return newest_ != old; });
  return newest_;
}

void StatusBoard::publish(std::shared_ptr<const AgentStatus> status, SteadyTime now) {
  {
    const std::lock_guard lock(mutex_);
    newest_.swap(status);
    newest_at_ = now;
    asked_ = false;
  }
  published_.notify_all();
}  // frees the previous status here, outside of the lock

}  // namespace fxagent
