#include "agent/uplink/shutdown.h"

#include <chrono>
#include <string>
#include <utility>

#include "agent/handover/status.h"
#include "agent/log/log.h"

namespace fxagent {
namespace {

constexpr std::chrono::seconds kDrainFor{3};
constexpr std::chrono::seconds kCloseFor{1};

}  // namespace

Farewell::Farewell(JsonPayload& payload, Outgoing& outgoing, std::function<std::int64_t()> utc_ms)
    : payload_(payload), outgoing_(outgoing), utc_ms_(std::move(utc_ms)) {}

void Farewell::say(SteadyTime now) {
  by_ = now + kWithin;
  outgoing_.send(*this, payload_.agent_offline(utc_ms_()));
}

void Farewell::delivered(std::uint64_t, SteadyTime now) {
  if (by_) by_ = now;
}

void Farewell::failed(const DeliveryFailed& event, SteadyTime now) { delivered(event.id, now); }

void Shutdown::begin(SteadyTime now) {
  phase_ = Phase::draining;
  deadline_ = now + kDrainFor;
  parts_.farewell.withdraw();  // one for a broker that we leave, if any
  parts_.session.begin_end(now);
}

void Shutdown::step(SteadyTime now) {
  const bool over = now >= next_wake() || parts_.session.is_waiting();
  switch (phase_) {
    case Phase::running:
    case Phase::finished:
      return;
    case Phase::draining:
      if (parts_.session.is_connected() && (over || drained())) {
        phase_ = Phase::farewell;
        return parts_.farewell.say(now);
      }
      if (over) finish(now);
      return;
    case Phase::farewell:
      if (!over) return;
      phase_ = Phase::closing;
      deadline_ = now + kCloseFor;
      return parts_.broker.disconnect();
    case Phase::closing:
      if (over) finish(now);
      return;
  }
}

void Shutdown::disconnected(SteadyTime now) {
  if (phase_ == Phase::closing) deadline_ = now;
}

SteadyTime Shutdown::next_wake() const {
  return phase_ == Phase::farewell ? parts_.farewell.by().value_or(deadline_) : deadline_;
}

bool Shutdown::drained() const {
  return parts_.intake.empty() && parts_.outgoing.empty() && parts_.results.empty() &&
         parts_.retained.empty() && !parts_.samples.has_live() && parts_.spool.empty();
}

void Shutdown::finish(SteadyTime now) {
  phase_ = Phase::finished;
  parts_.session.give_up(now);
  parts_.spool.close();
  const SampleCounts left = parts_.status.samples();
  log::info("uplink_stopped", {{"samples_left", std::to_string(left.waiting())},
                               {"results_left", std::to_string(parts_.results.size())}});
}

}  // namespace fxagent
