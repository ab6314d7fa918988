#include "agent/uplink/retained/retained_state.h"

#include <algorithm>
#include <chrono>

#include "agent/log/log.h"

namespace fxagent {
namespace {

using std::chrono::seconds;

constexpr seconds kRepairEvery{1};
// Time for a publication to come back to us. If it does not, other texts received before count as
// overwriting it.
constexpr seconds kComesBackWithin{2};

}  // namespace

RetainedState::RetainedState(const Config& config, const DeviceStates& states, JsonPayload& payload,
                             Outgoing& outgoing, JitteredBackoff& backoff, std::string what,
                             Source source)
    : config_(config),
      states_(states),
      payload_(payload),
      outgoing_(outgoing),
      backoff_(backoff),
      what_(std::move(what)),
      source_(std::move(source)) {}

void RetainedState::connection_began() {
  std::erase_if(due_, [](const auto& each) { return each.first.item != Item::clear; });
  for (auto& [key, due] : due_) due = {};
  everything_is_due();
  if (config_report_) config_report_is_due();
}

void RetainedState::connection_ended() {
  for (const auto& [id, flight] : std::exchange(flights_, {}))
    if (flight.key.item == Item::clear) clear(flight.key.topic);
  published_.clear();
  repairs_.clear();
  logged_.clear();
}

void RetainedState::everything_is_due() {
  agent_state_changed();
  for (std::uint32_t device = 0; device < config_.devices.size(); ++device) {
    if (config_.devices[device].is_vacant()) continue;
    due_[{Item::device_meta, device, {}}];
    if (states_.all()[device]) due_[{Item::device_state, device, {}}];
  }
}

void RetainedState::change(const ConfigChange& change) {
  for (const std::uint32_t device : change.devices_end) forget(device);
  const std::string base = config_.base_topic() + "/";
  for (const std::uint32_t device : change.devices_begin) {
    // The device is back: its topics must not be cleared.
    for (const char* topic : {"/state", "/meta"}) {
      const Key back{Item::clear, 0, base + config_.devices[device].name + topic};
      due_.erase(back);
      std::erase_if(flights_, [&](const auto& each) { return each.second.key == back; });
    }
    due_[{Item::device_meta, device, {}}];
  }
  for (const std::string& name : change.devices_gone)
    for (const char* topic : {"/state", "/meta"}) clear(base + name + topic);
}

/// Removes everything that refers to this device index.
void RetainedState::forget(std::uint32_t device) {
  const auto is_its_own = [device](const Key& key) {
    return key.device == device &&
           (key.item == Item::device_state || key.item == Item::device_meta);
  };
  const auto entry = [&](const auto& each) { return is_its_own(each.first); };
  std::erase_if(due_, entry);
  std::erase_if(published_, entry);
  std::erase_if(repairs_, entry);
  std::erase_if(logged_, is_its_own);
  std::erase_if(flights_, [&](const auto& each) { return is_its_own(each.second.key); });
}

void RetainedState::heard(Item item, std::uint32_t device, std::string_view payload,
                          SteadyTime now) {
  const Key key{item, device, {}};
  const auto found = published_.find(key);
  if (found == published_.end() || due_.contains(key)) return;  // ours is still pending
  Published& ours = found->second;
  if (std::hash<std::string_view>{}(payload) == ours.hash) {
    ours.came_back = true;
    repairs_.erase(key);
    return;
  }
  // The broker keeps the order on a topic: a text that arrives before ours was there before it.
  const SteadyTime overwritten = ours.came_back ? now : ours.at + kComesBackWithin;
  repairs_.try_emplace(key, std::max(overwritten, ours.at + kRepairEvery));
}

void RetainedState::pump(SteadyTime now) {
  std::erase_if(repairs_, [&](const auto& repair) {
    const auto& [key, at] = repair;
    if (at > now) return false;
    due_.try_emplace(key);
    if (logged_.insert(key).second)
      log::warn("retained_state_overwritten",
                {{"topic", publication_of(key, now).topic},
                 {"note",
                  "another client published there, or the broker published this agent's last will; "
                  "the agent publishes its own state again"}});
    return true;
  });
  for (auto next = due_.begin(); next != due_.end() && outgoing_.has_room();) {
    const auto current = next++;
    if (current->second.not_before > now) continue;
    auto taken = due_.extract(current);
    Publication publication = publication_of(taken.key(), now);
    if (taken.key().item <= Item::device_meta) {
      published_[taken.key()] = {std::hash<std::string_view>{}(publication.payload), now};
      repairs_.erase(taken.key());
    }
    Flight flight{std::move(taken.key()), taken.mapped(), publication.topic,
                  publication.payload.empty()};
    flights_.emplace(outgoing_.send(*this, std::move(publication)), std::move(flight));
  }
}

Publication RetainedState::publication_of(const Key& key, SteadyTime now) {
  switch (key.item) {
    case Item::agent_state:
      return source_.agent_state();
    case Item::device_state:
      return payload_.device_state(*states_.all()[key.device]);
    case Item::device_meta:
      return payload_.device_meta(key.device);
    case Item::health:
      return source_.health(now);
    case Item::config_report:
      return retained(config_.base_topic() + std::string(kReportedTopic),
                      config_report_.value_or(""));
    case Item::clear:
      break;
  }
  return retained(key.topic);
}

void RetainedState::delivered(std::uint64_t id, SteadyTime) {
  const auto found = flights_.extract(id);
  if (found.empty()) return;  // of a removed device
  const Flight& flight = found.mapped();
  if (flight.key.item == Item::config_report && flight.clears && config_report_ == "")
    config_report_.reset();
}

void RetainedState::failed(const DeliveryFailed& event, SteadyTime now) {
  const auto found = flights_.find(event.id);
  if (found == flights_.end()) return;  // of a removed device
  log_failed(what_, event, log::Field("topic", log::excerpt(found->second.topic)));
  if (is_final(event.reason_code)) return delivered(event.id, now);
  const auto& [key, due, topic, clears] = found->second;
  due_.insert_or_assign(
      key, Due{now + backoff_.after(due.failures), due.failures + 1, event.reason_code != 0});
  flights_.erase(found);
}

bool RetainedState::is_refused() const {
  const auto counts = [this](const Key& key, const Due& due) {
    const bool clears =
        key.item == Item::clear || (key.item == Item::config_report && config_report_ == "");
    return due.refused && !clears;
  };
  return std::ranges::any_of(due_, [&](const auto& e) { return counts(e.first, e.second); }) ||
         std::ranges::any_of(flights_,
                             [&](const auto& e) { return counts(e.second.key, e.second.due); });
}

SteadyTime RetainedState::next_wake(SteadyTime now) const {
  SteadyTime wake = SteadyTime::max();
  for (const auto& [key, due] : due_)
    if (due.not_before > now) wake = std::min(wake, due.not_before);
  for (const auto& [key, due] : repairs_) wake = std::min(wake, std::max(due, now));
  return wake;
}

}  // namespace fxagent
