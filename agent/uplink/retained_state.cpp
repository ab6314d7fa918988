#include "agent/uplink/retained_state.h"

#include <algorithm>
#include <utility>

#include "agent/log/log.h"
#include "agent/uplink/puback.h"

namespace fxagent {

RetainedState::RetainedState(const Config& config, Payload& payload, Outgoing& outgoing,
                             JitteredBackoff& backoff, Source source)
    : payload_(payload),
      outgoing_(outgoing),
      backoff_(backoff),
      source_(std::move(source)),
      states_(config.devices.size()) {}

void RetainedState::connection_began() {
  due_.clear();
  agent_state_changed();
  health_is_due();
  for (std::uint32_t device = 0; device < states_.size(); ++device) {
    due_[{Item::device_meta, device, {}}];
    if (states_[device]) due_[{Item::device_state, device, {}}];
  }
}

void RetainedState::set(DeviceStatus status) {
  const std::uint32_t device = status.device;
  states_.at(device) = std::make_shared<const DeviceStatus>(std::move(status));
}

void RetainedState::pump(SteadyTime now) {
  for (auto next = due_.begin(); next != due_.end() && outgoing_.has_room();) {
    const auto current = next++;
    if (current->second.not_before > now) continue;
    auto taken = due_.extract(current);
    const std::uint64_t id = outgoing_.send(*this, publication_of(taken.key(), now));
    flights_.emplace(id, Flight{std::move(taken.key()), taken.mapped().failures});
  }
}

Publication RetainedState::publication_of(const Key& key, SteadyTime now) {
  switch (key.item) {
    case Item::agent_state:
      return source_.agent_state();
    case Item::device_state:
      return payload_.device_state(*states_[key.device]);
    case Item::device_meta:
      return payload_.device_meta(key.device);
    case Item::health:
      return source_.health(now);
    case Item::clear:
      break;
  }
  Publication publication;
  publication.topic = key.topic;
  publication.retain = Retain::yes;
  return publication;
}

void RetainedState::delivered(std::uint64_t id, SteadyTime) { flights_.erase(id); }

void RetainedState::failed(const DeliveryFailed& event, SteadyTime now) {
  const Flight flight = std::move(flights_.extract(event.id).mapped());
  log::warn("publish_refused",
            {{"what", "state"}, {"code", hex_code(event.reason_code)}, {"reason", event.text}});
  if (is_final(event.reason_code)) return;
  due_.insert_or_assign(flight.key,
                        Due{now + backoff_.after(flight.failures), flight.failures + 1});
}

SteadyTime RetainedState::next_wake(SteadyTime now) const {
  SteadyTime wake = SteadyTime::max();
  for (const auto& [key, due] : due_)
    if (due.not_before > now) wake = std::min(wake, due.not_before);
  return wake;
}

}  // namespace fxagent
