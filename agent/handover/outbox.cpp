#include "agent/handover/outbox.h"

#include <iterator>
#include <utility>

namespace fxagent {

template <class Put>
void Outbox::push_urgent(Put put) {
  {
    const std::lock_guard lock(mutex_);
    put();
    signalled_ = true;
    urgent_ = true;
  }
  changed_.notify_one();
}

void Outbox::push(Telemetry message) {
  if (message.seq > highest_seq()) highest_seq_.store(message.seq, std::memory_order_relaxed);
  bool wake = false;
  {
    const std::lock_guard lock(mutex_);
    ++pushed_;
    telemetry_.push_back(std::move(message));
    while (telemetry_.size() > max_telemetry_) {
      ++waiting_.dropped[telemetry_.front().device];
      telemetry_.pop_front();
    }
    signalled_ = true;
    wake = !gathering_;
  }
  if (wake) changed_.notify_one();
}

void Outbox::push(CommandResult result) {
  push_urgent([&] { waiting_.results.push_back(std::move(result)); });
}

void Outbox::push(DeviceStatus status) {
  push_urgent([&] { waiting_.states.push_back(std::move(status)); });
}

void Outbox::push(FieldHealth health) {
  push_urgent([&] {
    waiting_.health = std::move(health);
    waiting_.pushed_at_health = pushed_;
  });
}

void Outbox::post(Call call) {
  push_urgent([&] { waiting_.calls.push_back(std::move(call)); });
}

void Outbox::notify() {
  push_urgent([] {});
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
  urgent_ = false;
}

void Outbox::gather(SteadyTime deadline) {
  std::unique_lock lock(mutex_);
  gathering_ = true;
  changed_.wait_until(lock, deadline, [this] { return urgent_; });
  gathering_ = false;
}

}  // namespace fxagent
