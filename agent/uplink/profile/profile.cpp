#include "agent/uplink/profile/profile.h"

#include <algorithm>
#include <utility>

#include "agent/log/log.h"
#include "agent/text/json_writer.h"

namespace fxagent {

void ignore_command(const Message& message, const std::string& note) {
  log::warn("command_ignored", {{"topic", log::excerpt(message.topic)}, {"note", note}});
}

bool only_clears(const Message& message, const MqttConfig& mqtt) {
  return message.payload.empty() && (message.retained || mqtt.version != 5);
}

bool is_for_link(const Config& config, const Message& message, std::string_view name) {
  if (std::ranges::find(config.links, name, &LinkConfig::name) == config.links.end()) return false;
  ignore_command(message, "commands for links come from the broker of mqtt only");
  return true;
}

RelayedCommand relayed_command(const Message& message, std::string device, std::string sender) {
  RelayedCommand command{static_cast<const MessageProperties&>(message), std::move(device), {}};
  command.sender = std::move(sender);
  command.response_topic.clear();  // the result goes where the profile says
  return command;
}

std::string write_command(std::string_view id, std::string_view tag, std::string_view value) {
  json::Writer command;
  command.begin_object().key("id").string(id).key("op").string("write");
  return command.key("tag").string(tag).key("value").raw(value).end_object().take();
}

}  // namespace fxagent
