#include "agent/uplink/session/shutdown.h"

namespace fxagent {
namespace {

constexpr std::chrono::seconds kFarewellFor{1};
constexpr std::chrono::seconds kCloseFor{1};

}  // namespace

void Farewell::say(SteadyTime now) {
  outgoing_.drop_waiting();
  by_ = now;
  auto last = last_words_();
  if (last.empty()) return;
  by_ = now + kFarewellFor;
  outgoing_.send_group(*this, std::move(last));
}

void Farewell::delivered(std::uint64_t, SteadyTime now) {
  if (by_) by_ = now;
}

void Farewell::failed(const DeliveryFailed& event, SteadyTime now) {
  log_failed(what_, event);
  delivered(event.id, now);
}

void Shutdown::begin(SteadyTime now) {
  phase_ = Phase::draining;
  deadline_ = now + drain_for_;
  farewell_.withdraw();  // one for a broker that we leave, if any
}

void Shutdown::step(bool drained, SteadyTime now) {
  const bool over = now >= next_wake() || session_.is_idle();
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
      return session_.disconnect();
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
