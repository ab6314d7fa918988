#include "agent/uplink/own_topics.h"

#include "agent/log/log.h"
#include "agent/text/text.h"
#include "agent/uplink/topics.h"

namespace fxagent {

OwnTopics::OwnTopics(Parts parts, std::string boot,
                     std::function<bool(const std::string& boot)> is_ours)
    : parts_(parts),
      base_(parts.config.base_topic()),
      identity_(std::move(boot), std::move(is_ours)) {}

void OwnTopics::hear(const Message& message, SteadyTime now) {
  parts_.intake.hear(message);
  if (const auto name = device_of(message.topic, base_, "command"))
    return hear_command(message, *name);
  if (message.topic == base_ + std::string(kDesiredTopic)) {
    if (parts_.config.remote.enabled && configs_.desired && !parts_.shutdown.has_begun())
      configs_.desired(message.payload);
    return;
  }
  // During shutdown the final state must stay as it is, and so must the offline state at a broker
  // that we leave for another one.
  if (!parts_.shutdown.has_begun() && !parts_.farewell.by()) hear_state(message, now);
}

void OwnTopics::hear_command(const Message& message, std::string_view name) {
  const bool is_known = parts_.commands.knows(name);
  if (!is_known) log::warn("command_for_unknown_device", {{"topic", log::excerpt(message.topic)}});
  if (is_known || is_name(name))
    parts_.intake.add(message, std::string(name), parts_.results.is_full());
}

void OwnTopics::hear_state(const Message& message, SteadyTime now) {
  using Item = RetainedState::Item;
  if (message.topic == base_ + "/state") {
    identity_.heard(message.payload, now);
    return parts_.retained.heard(Item::agent_state, 0, message.payload, now);
  }
  const auto of_state = device_of(message.topic, base_, "state");
  const auto name = of_state ? of_state : device_of(message.topic, base_, "meta");
  if (!name) return;
  if (const auto device = parts_.commands.device_named(*name)) {
    if (conflict_) return;  // two agents would overwrite each other's states endlessly
    const Item item = of_state ? Item::device_state : Item::device_meta;
    parts_.retained.heard(item, *device, message.payload, now);
  } else if (parts_.subscriptions.looks_for_leftovers() && !message.payload.empty() &&
             parts_.retained.clear(message.topic)) {
    log::info("retained_topic_cleared", {{"topic", log::excerpt(message.topic)}});
  }
}

void OwnTopics::report_config(std::string text, std::string audit) {
  parts_.retained.set_config_report(std::move(text));
  if (!parts_.shutdown.has_begun()) parts_.retained.config_report_is_due();
  if (!audit.empty() && parts_.store != nullptr) parts_.store->journal().note(std::move(audit));
}

void OwnTopics::connection_began(SteadyTime now) {
  const Session& session = parts_.session;
  identity_.connection_began(session.server(), now, session.stable_after());
  if (configs_.connection) configs_.connection(true, now);
}

void OwnTopics::connection_ended(SteadyTime now) {
  identity_.connection_ended();
  if (configs_.connection) configs_.connection(false, now);
}

void OwnTopics::follow_conflict(SteadyTime now) {
  if (parts_.shutdown.has_begun()) return;
  // MQTT 5 has a reason code for this; on 3.1.1 the broker acknowledges what it discards.
  if (identity_.keep(now, parts_.intake.is_holding()) && parts_.config.mqtt.version == 4)
    warn_of_unheard();
  const auto other = identity_.other();
  if (other == conflict_) return;
  const bool goes_on = other && conflict_ && *conflict_ != IdentityConflict::kUnknown;
  conflict_ = other;
  parts_.commands.set_conflict(other.value_or(""));
  parts_.status.set_conflict(other.value_or(""));
  // Our state reports a third agent when it is next restored. If each agent published it at once,
  // they would answer each other endlessly.
  if (goes_on) return;
  if (other)
    log::error("identity_conflict",
               {{"other_boot", *other},
                {"note",
                 "another agent has the same id: both refuse commands until one is gone; give each "
                 "agent its own agent.id and client_id"}});
  else
    log::info("identity_conflict", {{"state", "over"}});
  if (!parts_.session.is_connected()) return;
  if (other)
    parts_.retained.agent_state_changed();
  else
    parts_.retained.everything_is_due();  // the other agent may have overwritten all of it
  parts_.status.request_health(now);
}

void OwnTopics::warn_of_unheard() {
  log::warn(
      "own_state_not_heard",
      {{"topic", base_ + "/state"},
       {"note",
        "the broker acknowledges the agent's messages but does not send the agent's own state "
        "back. Its access rules may not include this agent's user, which MQTT 3.1.1 cannot "
        "report: all samples may be lost. fxagent acl prints the rules that the agent needs"}});
}

}  // namespace fxagent
