#include "agent/uplink/profile/json_profile.h"

#include <chrono>
#include <utility>

#include "agent/uplink/topics.h"

namespace fxagent {
namespace {

// After the broker has refused a state; it may have been a limit that is over by then.
constexpr std::chrono::seconds kAgainAfter{30};

}  // namespace

JsonProfile::JsonProfile(const Config& config, std::string boot, std::string version,
                         std::int64_t since_ms, std::string broker, RelayCommand relay)
    : config_(config),
      payload_(config, std::move(boot), std::move(version), broker),  // before it is moved
      since_ms_(since_ms),
      broker_(std::move(broker)),
      relay_(std::move(relay)),
      states_(config.devices.size()) {}

std::vector<Subscription> JsonProfile::subscriptions() const {
  if (!relay_) return {};
  return {{config_.base_topic() + "/+/command", /*no_local=*/true}};
}

void JsonProfile::connection_began(const Connected&) {
  is_connected_ = true;
  everything_is_due();
}

void JsonProfile::everything_is_due() {
  again_at_.reset();
  is_refused_ = false;
  greets_ = true;
  for (std::uint32_t device = 0; device < config_.devices.size(); ++device) {
    if (config_.devices[device].is_vacant()) continue;
    metas_.insert(device);
    if (states_.all()[device]) changed_.insert(device);
  }
}

void JsonProfile::connection_ended() {
  is_connected_ = false;
  again_at_.reset();
  metas_.clear();
  changed_.clear();
}

void JsonProfile::hear(const Message& message) {
  const std::string base = config_.base_topic();
  const auto device = device_of(message.topic, base, "command");
  if (!device || !relay_) return;
  if (message.payload.empty()) return;  // it clears a retained topic
  if (is_for_link(config_, message, *device)) return;
  RelayedCommand command = relayed_command(message, std::string(*device), broker_);
  command.payload = message.payload;
  command.reply = [this,
                   topic = base + "/" + command.device + "/result"](const std::string& result) {
    results_.push_back({.topic = topic, .payload = result});
  };
  relay_(std::move(command));
}

void JsonProfile::device_state(const DeviceStatus& status) {
  states_.set(status);
  changed_.insert(status.device);
}

void JsonProfile::change(const ConfigChange& change) {
  states_.change(change);
  for (const std::uint32_t i : change.devices_end) {
    metas_.erase(i);
    changed_.erase(i);
  }
  if (is_connected_)
    for (const std::string& name : change.devices_gone)
      for (const char* topic : {"/state", "/meta"})
        cleared_.push_back(retained(config_.base_topic() + "/" + name + topic));
  metas_.insert(change.devices_begin.begin(), change.devices_begin.end());
}

std::vector<Publication> JsonProfile::due(SteadyTime now, std::int64_t) {
  if (std::exchange(is_refused_, false)) again_at_ = now + kAgainAfter;
  if (again_at_ && now >= *again_at_) everything_is_due();
  std::vector<Publication> due;
  if (std::exchange(greets_, false)) {
    const auto reason =
        relay_ ? std::nullopt : std::optional<std::string>("this broker sends no commands");
    due.push_back(payload_.agent_online(since_ms_, reason, std::nullopt));
  } else if (!cleared_.empty()) {
    due.push_back(std::move(cleared_.front()));
    cleared_.pop_front();
  } else if (!changed_.empty()) {
    const auto device = changed_.extract(changed_.begin()).value();
    due.push_back(payload_.device_state(*states_.all()[device]));
  } else if (!metas_.empty()) {
    due.push_back(payload_.device_meta(metas_.extract(metas_.begin()).value()));
  }
  return due;
}

}  // namespace fxagent
