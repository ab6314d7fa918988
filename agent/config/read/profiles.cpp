#include "agent/config/read/sections.h"

#include <algorithm>
#include <array>
#include <initializer_list>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <unordered_set>
#include <utility>

#include "agent/config/json/tree.h"
#include "agent/config/keys.h"
#include "agent/config/plain_topic.h"
#include "agent/config/suggestions.h"

namespace fxagent {
namespace {

/// Replaces each `{name}` with the value of the key `name`, if `text` has it. Returns false, and
/// reports that, if there is no value.
bool put_name(ConfigReader& reader, const ConfigNode& node, KeyRef key, std::string& text) {
  const std::string place = "{" + std::string(key->name) + "}";
  const auto value = reader.text(node, key);
  std::size_t at = text.find(place);
  if (at == text.npos) {
    if (value) reader.warn(*node.find(key->name), "has no effect: the topic has no " + place);
    return true;
  }
  if (!value) {
    reader.error(node, "the topic has " + place + ": set " + std::string(key->name));
    return false;
  }
  for (; at != text.npos; at = text.find(place, at + value->size()))
    text.replace(at, place.size(), *value);
  return true;
}

/// Returns the topics that the agent has without this profile.
std::unordered_set<std::string> own_topics(const Config& config) {
  const std::string base = config.base_topic() + "/";
  std::unordered_set<std::string> topics;
  for (const char* level :
       {"state", "health", "plain", "sparkplug", "config/desired", "config/reported"})
    topics.insert(base + level);
  for (const LinkConfig& link : config.links)
    for (const char* level : {"/command", "/result"}) topics.insert(base + link.name + level);
  for (const DeviceConfig& device : config.devices) {
    for (const char* level : {"/state", "/meta", "/command", "/result"})
      topics.insert(base + device.name + level);
    for (const GroupConfig& group : device.groups)
      for (const char* level : {"", "/history"})
        topics.insert(base + device.name + "/data/" + group.name + level);
  }
  return topics;
}

/// Returns why two tags, or a tag and a topic of the json profile, would share a topic.
std::optional<std::string> topic_fault(const PlainTopic& topics, const Config& config) {
  const auto own = own_topics(config);
  std::unordered_set<std::string> taken;
  // A name that is wrong or stands twice, and a wrong group, are already reported.
  std::unordered_set<std::string_view> devices{""};
  for (const DeviceConfig& device : config.devices) {
    if (!devices.insert(device.name).second) continue;
    std::unordered_set<std::string_view> tags{""};
    for (const TagConfig& tag : device.tags) {
      if (!tags.insert(tag.name).second || tag.group >= device.groups.size()) continue;
      const std::string topic = topics.of(device.name, device.groups.at(tag.group).name, tag.name);
      const auto gives = [&, name = std::string(tag.name)](const std::string& what) {
        std::string text = "gives the tag ";
        return text.append(name).append(" of ").append(device.name).append(" the topic ") += what;
      };
      for (const char* level : {"", "/set", "/result", "/history"})
        if (own.contains(topic + level))
          return gives(topic + level + ", which the agent uses itself");
      if (!taken.insert(topic).second)
        return gives(topic + ", which another tag has: use {device}");
    }
  }
  return std::nullopt;
}

void read_plain(ConfigReader& reader, const ConfigNode& node, const Config& config,
                ProfileConfig& profile) {
  const ConfigKey& key = config_key("profiles[].topic");
  profile.topic = reader.text(node, key).value_or(std::string(key.word()));
  const std::array known{put_name(reader, node, "profiles[].site", profile.topic),
                         put_name(reader, node, "profiles[].area", profile.topic),
                         put_name(reader, node, "profiles[].line", profile.topic)};
  if (contains(known, false)) return;
  const ConfigNode& at = node.find("topic") != nullptr ? *node.find("topic") : node;
  const auto topics = PlainTopic::parse(profile.topic, config.root, config.id);
  if (!topics) return reader.error(at, topics.error());
  if (const auto fault = topic_fault(*topics, config)) reader.error(at, *fault);
}

/// Returns why a tag and another one would share a key in ThingsBoard, which has {tag}_bad for the
/// reason and {tag}_0, {tag}_1 … for the elements of an array.
std::optional<std::string> key_fault(const Config& config) {
  for (const DeviceConfig& device : config.devices) {
    std::map<std::string, const Point*> points;
    for (const TagConfig& tag : device.tags) points.emplace(std::string(tag.name), &tag.point);
    for (const auto& [name, point] : points) {
      const std::size_t end = name.rfind('_');
      if (end == name.npos) continue;
      const auto other = points.find(name.substr(0, end));
      if (other == points.end()) continue;
      const std::string last = name.substr(end + 1);
      bool is_shared = last == "bad";
      for (int i = 0; other->second->is_array && i < other->second->count; ++i)
        is_shared = is_shared || last == std::to_string(i);
      if (is_shared)
        return "the tag " + name + " of " + device.name +
               " has a key that ThingsBoard also gets for the tag " + other->first +
               ": rename one of them";
    }
  }
  return std::nullopt;
}

void read_sparkplug(ConfigReader& reader, const ConfigNode& node, const Config& config,
                    ProfileConfig& profile) {
  const auto id = [&](KeyRef key) {
    const std::string text = reader.text(node, key).value_or("");
    if (text.find_first_of("/+#") != text.npos)
      reader.error(*node.find(key->name), "must not have /, + or #");
    return text;
  };
  profile.group = id("profiles[].group");
  if (node.find("group") == nullptr) reader.error(node, "needs group, the Sparkplug group id");
  profile.node = id("profiles[].node");
  if (profile.node.empty()) profile.node = config.id;
  profile.host = id("profiles[].host");
  profile.old_state = reader.boolean(node, "profiles[].old_state");
  if (profile.old_state && profile.host.empty())
    reader.warn(*node.find("old_state"), "has no effect without host");
}

/// Returns the profile that comes with `commands` of a `sparkplug`.
ProfileConfig typed_commands(ConfigReader& reader, const ConfigNode& node, const Config& config,
                             ProfileConfig sparkplug) {
  const BrokerConfig* broker = broker_named(config, sparkplug.broker);
  if (broker != nullptr && !broker->commands)
    reader.error(
        *node.find("commands"),
        "the broker " + broker->name + " may not send commands: add \"commands\": true to it");
  sparkplug.kind = ProfileConfig::Kind::sparkplug_commands;
  sparkplug.old_state = false;
  return sparkplug;
}

void read_prefix(ConfigReader& reader, const ConfigNode& node, ProfileConfig& profile) {
  const ConfigKey& key = config_key("profiles[].prefix");
  profile.prefix = reader.text(node, key).value_or(std::string(key.word()));
  if (profile.prefix.find_first_of("+#") != profile.prefix.npos ||
      profile.prefix.starts_with('/') || profile.prefix.ends_with('/') ||
      profile.prefix.starts_with('$'))
    reader.error(*node.find("prefix"), "must not have + or #, nor / at either end or $ before it");
}

/// Reports keys of other kinds.
void check_kind(ConfigReader& reader, const ConfigNode& node, ProfileConfig::Kind kind) {
  const auto only = [&](ProfileConfig::Kind owner, std::initializer_list<std::string_view> keys) {
    const std::string word(config_keys::kProfiles.at(static_cast<std::size_t>(owner)));
    for (const std::string_view key : keys)
      if (const ConfigNode* at = node.find(key); at != nullptr && kind != owner)
        reader.error(*at, "belongs to the kind " + word);
  };
  only(ProfileConfig::Kind::homeassistant, {"prefix"});
  only(ProfileConfig::Kind::thingsboard, {"deadline_s"});
  only(ProfileConfig::Kind::plain, {"topic", "site", "area", "line"});
  only(ProfileConfig::Kind::sparkplug, {"group", "node", "host", "old_state", "commands"});
}

}  // namespace

void read_profiles(ConfigReader& reader, const ConfigNode& list, Config& config) {
  std::set<std::string> names;
  bool has_json = false;
  for (const ConfigNode& node : list.children) {
    if (!reader.check_object(node, "profiles[]")) continue;
    const auto kind = reader.choice(node, "profiles[].kind");
    if (!kind) continue;
    ProfileConfig profile;
    profile.kind = static_cast<ProfileConfig::Kind>(*kind);
    profile.broker = reader.name(node, "profiles[].broker").value_or("");
    if (!profile.broker.empty() && broker_named(config, profile.broker) == nullptr)
      reader.error(*node.find("broker"), "no broker in brokers has the name " +
                                             shown(profile.broker) +
                                             in_place_of(profile.broker, names_in(config.brokers)));
    check_kind(reader, node, profile.kind);
    if (profile.kind == ProfileConfig::Kind::plain) read_plain(reader, node, config, profile);
    if (profile.kind == ProfileConfig::Kind::sparkplug)
      read_sparkplug(reader, node, config, profile);
    if (profile.kind == ProfileConfig::Kind::homeassistant) read_prefix(reader, node, profile);
    if (profile.kind == ProfileConfig::Kind::thingsboard) {
      if (const auto fault = key_fault(config)) reader.error(node, *fault);
      if (profile.broker.empty())
        reader.warn(node,
                    "ThingsBoard does not accept the topics of json: if the broker of mqtt is "
                    "ThingsBoard, move it to brokers, and name it in \"broker\"");
    }
    reader.set_integer(profile.deadline, node, "profiles[].deadline_s");
    if (!names.insert(name_of(profile)).second)
      reader.error(node, "this kind stands twice for the same broker");
    if (profile.kind == ProfileConfig::Kind::json && profile.broker.empty()) {
      has_json = true;
      continue;
    }
    config.profiles.push_back(profile);
    if (reader.boolean(node, "profiles[].commands"))
      config.profiles.push_back(typed_commands(reader, node, config, std::move(profile)));
  }
  for (const ProfileConfig& profile : config.profiles)
    if (profile.kind == ProfileConfig::Kind::homeassistant && !profile.broker.empty() &&
        !names.contains("json@" + profile.broker))
      reader.error(list,
                   "homeassistant needs the topics of json on its broker: add "
                   "{\"kind\": \"json\", \"broker\": \"" +
                       profile.broker + "\"}");
  if (!has_json)
    reader.error(list, "needs {\"kind\": \"json\"}, the agent's own session on the broker of mqtt");
  for (const BrokerConfig& broker : config.brokers)
    if (!contains(config.profiles, broker.name, &ProfileConfig::broker))
      reader.warn(list, "no profile publishes to the broker " + broker.name +
                            ": one must have \"broker\": \"" + broker.name + "\"");
}

}  // namespace fxagent
