#include "agent/uplink/profile/json_profile.h"

#include <utility>

#include "agent/text/text.h"
#include "agent/uplink/topics.h"

namespace fxagent {

JsonProfile::JsonProfile(const Config& config, const ProfileConfig& profile, std::string boot,
                         std::string version, std::int64_t since_ms, RelayCommand relay)
    : config_(config),
      payload_(config, std::move(boot), std::move(version), profile.broker),
      since_ms_(since_ms),
      name_(name_of(profile)),
      broker_(profile.broker),
      relay_(std::move(relay)),
      states_(config.devices.size()) {
  if (!relay_) not_heard_why_ = "this broker sends no commands";
}

void JsonProfile::begin(Outgoing& outgoing, JitteredBackoff& backoff) {
  const auto agent_state = [this] {
    return payload_.agent_online(since_ms_, not_heard_why_, std::nullopt);
  };
  retained_.emplace(config_, states_, payload_, outgoing, backoff, name_,
                    RetainedState::Source{agent_state, {}});
}

std::vector<Subscription> JsonProfile::subscriptions() const {
  if (!relay_) return {};
  return {{config_.base_topic() + "/+/command", /*no_local=*/true}};
}

void JsonProfile::connection_began(const Connected&) {
  retained_->connection_began();
  awaits_suback_ = relay_ != nullptr;
}

void JsonProfile::connection_ended() {
  retained_->connection_ended();
  if (relay_) not_heard_why_.reset();
}

void JsonProfile::subscribed(const Subscribed& event) {
  awaits_suback_ = false;
  const auto why = event.granted ? std::nullopt : std::optional(event.text);
  if (std::exchange(not_heard_why_, why) != why) retained_->agent_state_changed();
}

void JsonProfile::hear(const Message& message) {
  const std::string base = config_.base_topic();
  const auto device = device_of(message.topic, base, "command");
  if (!device || !relay_) return;
  if (only_clears(message, broker_of(config_, broker_))) return;
  if (!is_name(*device)) return ignore_command(message, "no device can have this name");
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
  retained_->device_state_changed(status.device);
}

void JsonProfile::change(const ConfigChange& change) {
  states_.change(change);
  retained_->change(change);
}

/// The retained states send themselves. They wait for the SUBACK: a client that sees "online" may
/// send a command at once.
std::vector<Publication> JsonProfile::due(SteadyTime now, std::int64_t) {
  wake_ = SteadyTime::max();
  if (awaits_suback_) return {};
  retained_->pump(now);
  wake_ = retained_->next_wake(now);
  return {};
}

}  // namespace fxagent
