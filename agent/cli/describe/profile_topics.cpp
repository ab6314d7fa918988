#include "agent/cli/describe/topics.h"

#include <algorithm>
#include <utility>

#include "agent/config/plain_topic.h"

namespace fxagent::contract {
namespace {

using Topics = std::vector<ProfileTopic>;

constexpr std::string_view kProtobuf = "application/vnd.google.protobuf";
constexpr std::string_view kText = "text/plain";

ProfileTopic sent(std::string_view name, std::string address, std::string_view summary,
                  Retain retain = Retain::no, int qos = 1) {
  return {.name = name,
          .address = std::move(address),
          .summary = summary,
          .retain = retain,
          .qos = qos};
}

ProfileTopic received(std::string_view name, std::string address, std::string_view summary,
                      Retain retain = Retain::no) {
  ProfileTopic topic = sent(name, std::move(address), summary, retain);
  topic.sender = Sender::client;
  return topic;
}

ProfileTopic command(std::string_view name, std::string address, std::string_view summary) {
  ProfileTopic topic = received(name, std::move(address), summary);
  topic.is_command = true;
  return topic;
}

ProfileTopic with_type(std::string_view content_type, ProfileTopic topic) {
  topic.content_type = content_type;
  return topic;
}

void add_plain(const Config& config, const ProfileConfig& profile, Topics& out) {
  const std::string tag =
      PlainTopic::parse(profile.topic, config.root, config.id)->of("{device}", "{group}", "{tag}");
  const int qos = config.mqtt.qos;
  out.push_back(sent("plain_state", config.base_topic() + "/plain",
                     "State of the profile plain; also its last will", Retain::yes));
  out.push_back(
      sent("plain_value", tag, "The value of a tag; null while it is bad", Retain::yes, qos));
  out.push_back(sent("plain_history", tag + "/history",
                     "Values of an outage, as pairs of time in ms and value", Retain::no, qos));
  out.push_back(sent("plain_result", tag + "/result", "The result of each value that was set"));
  out.push_back(
      command("plain_command", tag + "/set", "A value to write to the tag. Never retain it"));
}

void add_sparkplug(const Config& config, const ProfileConfig& profile, Topics& out) {
  const std::string group = "spBv1.0/" + profile.group + "/";
  const std::string node = "/" + profile.node;
  const std::string device = node + "/{device}";
  out.push_back(with_type(
      kText, sent("sparkplug_marker", config.base_topic() + "/sparkplug",
                  "Empty. Its acknowledgement proves the delivery of what was sent before it")));
  for (ProfileTopic topic :
       {sent("sparkplug_node_birth", group + "NBIRTH" + node, "Birth of the node", Retain::no, 0),
        sent("sparkplug_node_death", group + "NDEATH" + node,
             "Death of the node: the last will, or with QoS 0 when the agent ends"),
        sent("sparkplug_device_birth", group + "DBIRTH" + device,
             "Birth of a device, with all its metrics", Retain::no, 0),
        sent("sparkplug_device_death", group + "DDEATH" + device, "Death of a device", Retain::no,
             0),
        sent("sparkplug_device_data", group + "DDATA" + device, "Metrics that have changed",
             Retain::no, 0),
        command("sparkplug_node_command", group + "NCMD" + node,
                "A command for the node: a rebirth"),
        command("sparkplug_device_command", group + "DCMD" + device,
                "Commands for a device: each metric is one")})
    out.push_back(with_type(kProtobuf, std::move(topic)));
  if (profile.host.empty()) return;
  ProfileTopic host =
      received("sparkplug_host", (profile.old_state ? "STATE/" : "spBv1.0/STATE/") + profile.host,
               "State of the primary host", Retain::yes);
  if (profile.old_state) host.content_type = kText;
  out.push_back(std::move(host));
}

void add_typed_commands(const ProfileConfig& profile, Topics& out) {
  const std::string group = "spCv1.0/" + profile.group + "/";
  const std::string node = "/" + profile.node;
  const std::string device = node + "/{device}";
  const auto add = [&](ProfileTopic topic, int qos = 0) {
    topic.qos = qos;
    out.push_back(with_type(kProtobuf, std::move(topic)));
  };
  add(sent("sparkplug_c_node_birth", group + "NBIRTH" + node, "Birth of the node"));
  add(sent("sparkplug_c_node_rebirth", group + "NREBIRTH" + node,
           "The same, because a host asked"));
  add(sent("sparkplug_c_node_death", group + "NDEATH" + node,
           "Death of the node: the last will, or with QoS 0 when the agent ends"),
      1);
  add(sent("sparkplug_c_device_birth", group + "DBIRTH" + device,
           "Birth of a device, with its commands"));
  add(sent("sparkplug_c_device_rebirth", group + "DREBIRTH" + device,
           "The same, because a host asked"));
  add(sent("sparkplug_c_device_death", group + "DDEATH" + device, "Death of a device"));
  add(sent("sparkplug_c_node_answer", group + "NRESP" + node,
           "The answer to a command for the node: it has none"));
  add(sent("sparkplug_c_device_answer", group + "DRESP" + device, "The answer to a command"));
  add(command("sparkplug_c_rebirth", group + "REBIRTH" + node, "Asks for all births"));
  add(command("sparkplug_c_node_command", group + "NCMD" + node, "Typed commands for the node"));
  add(command("sparkplug_c_device_command", group + "DCMD" + device,
              "Typed commands for a device"));
  if (profile.host.empty()) return;
  out.push_back(received("sparkplug_c_host", "spCv1.0/STATE/" + profile.host,
                         "State of the primary host", Retain::yes));
}

void add_homeassistant(const ProfileConfig& profile, Topics& out) {
  out.push_back(sent("homeassistant_device", profile.prefix + "/device/{object}/config",
                     "Device discovery of Home Assistant", Retain::yes));
  out.back().is_read_back = true;
  out.push_back(with_type(kText, received("homeassistant_status", profile.prefix + "/status",
                                          "Birth message of Home Assistant")));
}

void add_thingsboard(Topics& out) {
  const std::string gateway = "v1/gateway/";
  out.push_back(sent("thingsboard_connect", gateway + "connect", "A device is online"));
  out.push_back(sent("thingsboard_disconnect", gateway + "disconnect", "A device is offline"));
  out.push_back(sent("thingsboard_telemetry", gateway + "telemetry", "Values"));
  out.push_back(sent("thingsboard_attributes", gateway + "attributes", "States of the devices"));
  out.push_back(sent("thingsboard_result", gateway + "rpc", "The result of each command"));
  out.push_back(command("thingsboard_command", gateway + "rpc", "A command for a device"));
}

}  // namespace

std::string ProfileTopic::filter() const {
  std::string out = address;
  for (const std::string_view placeholder : {"{device}", "{group}", "{tag}", "{object}"})
    if (const std::size_t brace = out.find(placeholder); brace != out.npos) {
      const std::size_t slash = out.rfind('/', brace);
      const std::size_t begin = slash == out.npos ? 0 : slash + 1;
      out.replace(begin, std::min(out.find('/', brace), out.size()) - begin, "+");
    }
  return out;
}

std::vector<ProfileTopic> profile_topics(const Config& config) {
  Topics out;
  for (const ProfileConfig& profile : config.profiles) {
    if (!profile.broker.empty()) continue;
    if (profile.kind == ProfileConfig::Kind::plain) add_plain(config, profile, out);
    if (profile.kind == ProfileConfig::Kind::sparkplug) add_sparkplug(config, profile, out);
    if (profile.kind == ProfileConfig::Kind::sparkplug_commands) add_typed_commands(profile, out);
    if (profile.kind == ProfileConfig::Kind::homeassistant) add_homeassistant(profile, out);
    if (profile.kind == ProfileConfig::Kind::thingsboard) add_thingsboard(out);
  }
  return out;
}

}  // namespace fxagent::contract
