#include "agent/outbox.h"

#include <iterator>
#include <utility>

namespace fxagent {

void Outbox::push(Telemetry message) {
  {
    const std::lock_guard lock(mutex_);
    ++pushed_;
    telemetry_.push_back(std::move(message));
    while (telemetry_.size() > max_telemetry_) {
      ++waiting_.dropped[telemetry_.front().device];
      telemetry_.pop_front();
    }
    signalled_ = true;
  }
  changed_.notify_one();
}

void Outbox::push(OrderNote order) {
  {
    const std::lock_guard lock(mutex_);
    waiting_.orders.push_back(std::move(order));
    signalled_ = true;
  }
  changed_.notify_one();
}

void Outbox::push(CommandResult result) {
  {
    const std::lock_guard lock(mutex_);
    waiting_.results.push_back(std::move(result));
    signalled_ = true;
  }
  changed_.notify_one();
}

void Outbox::push(DeviceStatus status) {
  {
    const std::lock_guard lock(mutex_);
    waiting_.states.push_back(std::move(status));
    signalled_ = true;
  }
  changed_.notify_one();
}

void Outbox::push(FieldHealth health) {
  {
    const std::lock_guard lock(mutex_);
    waiting_.health = std::move(health);
    waiting_.pushed_at_health = pushed_;
    signalled_ = true;
  }
  changed_.notify_one();
}

Outbox::Batch Outbox::take() {
  Batch batch;
  std::deque<Telemetry> telemetry;
  {
    const std::lock_guard lock(mutex_);
    std::swap(batch, waiting_);
    std::swap(telemetry, telemetry_);
    batch.pushed = pushed_;
  }
  batch.telemetry.assign(std::move_iterator(telemetry.begin()),
                         std::move_iterator(telemetry.end()));
  return batch;
}

void Outbox::wait_until(SteadyTime deadline) {
  std::unique_lock lock(mutex_);
  changed_.wait_until(lock, deadline, [this] { return signalled_; });
  signalled_ = false;
}

void Outbox::notify() {
  {
    const std::lock_guard lock(mutex_);
    signalled_ = true;
  }
  changed_.notify_one();
}

}  // namespace fxagent
