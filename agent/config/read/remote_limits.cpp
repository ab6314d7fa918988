#include "agent/config/read/sections.h"

#include <algorithm>
#include <array>
#include <string>
#include <string_view>

#include "agent/config/keys.h"
#include "agent/config/suggestions.h"
#include "agent/text/text.h"
#include "protocol/catalog.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

constexpr std::array kWords{"links"sv, "devices"sv, "mqtt.servers"sv, "commands.allow_run_stop"sv};
constexpr std::string_view kRange = "commands.allow:";
constexpr std::string_view kForms =
    "links, devices, mqtt.servers, commands.allow_run_stop, or commands.allow: and a range of "
    "addresses, after a protocol and a model for devices that are not in this file";

/// Returns the range on devices of `protocol`; an error if they do not have it. An empty `model`
/// means the widest model.
Result<Span> range_on(const ProtocolInfo& protocol, std::string_view model,
                      std::string_view range) {
  Options options = default_options(protocol);
  if (!protocol.models.empty())
    options["model"] = std::string(model.empty() ? protocol.models.back() : model);
  return protocol.make(options).and_then([&](const std::shared_ptr<const Codec>& codec) {
    return codec->addresses().parse_range(range);
  });
}

/// Cuts the first word off `text`.
std::string_view next_word(std::string_view& text) {
  const std::string_view word = text.substr(0, text.find(' '));
  text = trimmed(text.substr(word.size()));
  return word;
}

/// Reads "RANGE", "PROTOCOL RANGE" or "PROTOCOL MODEL RANGE".
void read_range(ConfigReader& reader, const ConfigNode& item, std::string_view text,
                RemoteLimits& limits) {
  RemoteRange entry;
  std::string_view rest = text;
  entry.protocol = find_protocol(next_word(rest));
  if (entry.protocol == nullptr) {
    entry.range = text;
    if (std::ranges::none_of(catalog(), [&](const ProtocolInfo& protocol) {
          return range_on(protocol, {}, text).has_value();
        }))
      return reader.error(item,
                          shown(entry.range) + " is not a range of addresses of any protocol");
  } else {
    if (!entry.protocol->models.empty()) {
      const std::string_view model = next_word(rest);
      if (!contains(entry.protocol->models, model))
        return reader.error(item, "needs a model of " + std::string(entry.protocol->name) +
                                      " after the protocol, " + one_of(entry.protocol->models));
      entry.model = model;
    }
    entry.range = rest;
    const auto span = range_on(*entry.protocol, entry.model, rest);
    if (!span)
      return reader.error(item, shown(entry.range) + " is not a range of addresses of " +
                                    std::string(entry.protocol->name) +
                                    (entry.model.empty() ? "" : " " + entry.model));
    entry.span = *span;
  }
  limits.allow.push_back(std::move(entry));
}

/// True if the word names a section that no remote config may change, or a key of one.
bool is_local_alone(std::string_view word) {
  return std::ranges::any_of(
      std::array{"agent"sv, "mqtt"sv, "store"sv, "http"sv, "metrics"sv, "recorder"sv, "pair"sv},
      [&](std::string_view section) {
        return word == section || (word.starts_with(section) && word[section.size()] == '.');
      });
}

void read_word(ConfigReader& reader, const ConfigNode& item, const std::string& word,
               RemoteLimits& limits) {
  if (word == "links") {
    limits.links = true;
  } else if (word == "devices") {
    limits.devices = true;
  } else if (word == "mqtt.servers") {
    limits.servers = true;
  } else if (word == "commands.allow_run_stop") {
    limits.run_stop = true;
  } else if (word.starts_with(kRange)) {
    read_range(reader, item, trimmed(std::string_view(word).substr(kRange.size())), limits);
  } else if (word == "commands.allow") {
    reader.error(item, "needs the addresses, as in \"commands.allow: D300-D399\"");
  } else if (is_local_alone(word)) {
    reader.error(item, shown(word) + " cannot be set remotely; these can: " + std::string(kForms));
  } else {
    reader.error(item, "must be " + std::string(kForms) + did_you_mean(word, kWords));
  }
}

}  // namespace

RemoteLimits read_remote_limits(ConfigReader& reader, const ConfigNode& agent) {
  RemoteLimits limits;
  limits.enabled = reader.boolean(agent, "agent.remote_config");
  limits.without_disk = reader.boolean(agent, "agent.remote_without_disk");
  const ConfigNode* given = agent.find("remote_allow");
  if (const ConfigNode* list = reader.array(agent, "agent.remote_allow")) {
    limits.links = false;
    limits.devices = false;
    for (const ConfigNode& item : list->children)
      if (const auto word = reader.text(item)) read_word(reader, item, *word, limits);
  }
  for (const auto key : {"remote_allow"sv, "remote_without_disk"sv})
    if (const ConfigNode* stray = agent.find(key); stray != nullptr && !limits.enabled)
      reader.warn(*stray, "has no effect without \"remote_config\": true");
  if (given != nullptr && given->children.empty() && limits.enabled)
    reader.warn(*given, "is empty: a remote config cannot change anything");
  return limits;
}

std::string to_string(const RemoteLimits& limits) {
  std::string text;
  const auto add = [&text](std::string_view word) {
    text += (text.empty() ? "" : ", ") + std::string(word);
  };
  if (limits.links) add("links");
  if (limits.devices) add("devices");
  if (limits.servers) add("mqtt.servers");
  if (limits.run_stop) add("commands.allow_run_stop");
  for (const RemoteRange& entry : limits.allow) {
    std::string of;
    if (entry.protocol != nullptr) of = std::string(entry.protocol->name) + ' ';
    if (!entry.model.empty()) of += entry.model + ' ';
    add("commands.allow " + of + entry.range);
  }
  return text.empty() ? "nothing" : text;
}

}  // namespace fxagent
