#include "agent/uplink/farewell.h"

#include <utility>

namespace fxagent {

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

}  // namespace fxagent
