#include "agent/uplink/shutdown.h"

#include <chrono>
#include <utility>

namespace fxagent {
namespace {

constexpr std::chrono::seconds kDrainFor{3};
constexpr std::chrono::seconds kFarewellFor{1};
constexpr std::chrono::seconds kCloseFor{1};

}  // namespace

Farewell::Farewell(JsonPayload& payload, Outgoing& outgoing, std::function<std::int64_t()> utc_ms)
    : payload_(payload), outgoing_(outgoing), utc_ms_(std::move(utc_ms)) {}

void Farewell::say(SteadyTime now) {
  by_ = now + kFarewellFor;
  outgoing_.send(*this, payload_.agent_offline(utc_ms_()));
}

void Farewell::delivered(std::uint64_t, SteadyTime now) {
  if (by_) by_ = now;
}

void Farewell::failed(const DeliveryFailed& event, SteadyTime now) { delivered(event.id, now); }

void Shutdown::begin(SteadyTime now) {
  phase_ = Phase::draining;
  deadline_ = now + kDrainFor;
  farewell_.withdraw();  // one for a broker that we leave, if any
  session_.begin_end(now);
}

void Shutdown::step(bool drained, SteadyTime now) {
  const bool over = now >= next_wake() || session_.is_waiting();
  switch (phase_) {
    case Phase::running:
    case Phase::finished:
      return;
    case Phase::draining:
      if (session_.is_connected() && (over || drained)) {
        phase_ = Phase::farewell;
        return farewell_.say(now);
      }
      if (over) phase_ = Phase::finished;
      return;
    case Phase::farewell:
      if (!over) return;
      phase_ = Phase::closing;
      deadline_ = now + kCloseFor;
      return broker_.disconnect();
    case Phase::closing:
      if (over) phase_ = Phase::finished;
      return;
  }
}

void Shutdown::disconnected(SteadyTime now) {
  if (phase_ == Phase::closing) deadline_ = now;
}

SteadyTime Shutdown::next_wake() const {
  return phase_ == Phase::farewell ? farewell_.by().value_or(deadline_) : deadline_;
}

}  // namespace fxagent
