#include "agent/uplink/sparkplug/primary_host.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "agent/log/log.h"
#include "agent/text/json_member.h"

namespace fxagent::sparkplug {

PrimaryHost::PrimaryHost(std::string topic, bool old_state)
    : topic_(std::move(topic)), old_state_(old_state) {}

void PrimaryHost::hear(std::string_view payload) {
  if (old_state_) {
    if (payload == "ONLINE" || payload == "OFFLINE")
      return set(payload == "ONLINE" ? State::online : State::offline, 0);
  } else {
    const auto state = parsed_json(payload);
    if (state.is_object() && state.contains("online") && state["online"].is_boolean() &&
        state.contains("timestamp") && state["timestamp"].is_number_integer())
      return set(state["online"].get<bool>() ? State::online : State::offline,
                 state["timestamp"].get<std::int64_t>());
  }
  log::warn("host_state_ignored", {{"topic", topic_},
                                   {"text", log::excerpt(payload)},
                                   {"note", old_state_ ? "expected ONLINE or OFFLINE"
                                                       : "expected {\"online\": true or false, "
                                                         "\"timestamp\": number}"}});
}

/// A state that is older than the last online state is a leftover.
void PrimaryHost::set(State state, std::int64_t timestamp) {
  const bool is_online = state == State::online;
  if (timestamp < (is_online ? last_ : last_online_))
    return log::warn("host_state_ignored",
                     {{"topic", topic_},
                      {"timestamp", std::to_string(timestamp)},
                      {"note", "its timestamp is older than that of the state before"}});
  last_ = timestamp;
  if (is_online) last_online_ = timestamp;
  if (state != state_)
    log::info("primary_host", {{"topic", topic_}, {"state", is_online ? "online" : "offline"}});
  state_ = state;
}

}  // namespace fxagent::sparkplug
