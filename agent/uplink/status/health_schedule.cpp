#include "agent/uplink/status/health_schedule.h"

#include <algorithm>
#include <chrono>
#include <utility>

namespace fxagent {
namespace {

// Interval of health.
constexpr std::chrono::seconds kTick{60};
// Health goes out with older counters after this.
constexpr std::chrono::seconds kCountersWithin{1};

}  // namespace

HealthSchedule::HealthSchedule(StatusSource& status, RetainedState& retained,
                               std::function<void()> ask_counters)
    : status_(status), retained_(retained), ask_counters_(std::move(ask_counters)) {}

void HealthSchedule::start(SteadyTime now) { next_tick_ = now + kTick; }

void HealthSchedule::request(SteadyTime now) {
  if (!ask_counters_) return retained_.health_is_due();
  if (counters_by_) return;
  counters_by_ = now + kCountersWithin;
  ask_counters_();
}

void HealthSchedule::counted() {
  if (std::exchange(counters_by_, std::nullopt)) retained_.health_is_due();
}

void HealthSchedule::report(bool is_connected, SteadyTime now) {
  if (now >= next_tick_) {
    next_tick_ = now + kTick;
    status_.tick(now);
    if (is_connected) request(now);
  }
  status_.answer(now);
  if (counters_by_ && now >= *counters_by_) counted();
}

SteadyTime HealthSchedule::next_wake() const {
  return counters_by_ ? std::min(next_tick_, *counters_by_) : next_tick_;
}

}  // namespace fxagent
