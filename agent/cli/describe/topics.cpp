#include "agent/cli/describe/topics.h"

#include <algorithm>
#include <utility>

#include "agent/config/plain_topic.h"

namespace fxagent::contract {
namespace {

std::string filled_in(std::string_view address, std::string_view placeholder,
                      std::string_view name) {
  std::string out(address);
  const std::size_t at = out.find(placeholder);
  return at == out.npos ? out : out.replace(at, placeholder.size(), name);
}

/// True if payloads of this topic have names of the device's tags.
bool has_tag_names(const Topic& topic) {
  return topic.schema == "meta" || topic.schema == "sample" || topic.schema == "history" ||
         topic.schema == "command";
}

void add_device(const Topic& topic, const std::string& address, const DeviceConfig& device,
                std::vector<Place>& out) {
  const std::string own = filled_in(address, "{device}", device.name);
  if (!topic.has("{group}")) {
    std::string schema(topic.schema);
    if (has_tag_names(topic)) schema = schema_name(device, topic.schema);
    out.push_back({&topic, own, std::move(schema), &device, nullptr});
    return;
  }
  for (const std::uint32_t index : used_groups(device)) {
    const GroupConfig& group = device.groups.at(index);
    out.push_back({&topic, filled_in(own, "{group}", group.name),
                   schema_name(device, topic.schema, &group), &device, &group});
  }
}

// ---- topics of profiles -------------------------------------------------------------------------

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

const std::vector<Topic>& topics() {
  using enum Sender;
  using enum Retain;
  using enum Quality;
  static const std::vector<Topic> all{
      {"agent_state", "state", agent, yes, one, "agent_state",
       "State of the agent; also its last will"},
      {"health", "health", agent, yes, one, "health",
       "Counters, after each connect and every 60 s"},
      {"device_state", "{device}/state", agent, yes, one, "device_state", "State of the device"},
      {"meta", "{device}/meta", agent, yes, one, "meta", "Description of the device's tags"},
      {"sample", "{device}/data/{group}", agent, no, as_configured, "sample",
       "Values of a group, read in one cycle"},
      {"history", "{device}/data/{group}/history", agent, no, as_configured, "history",
       "Samples that could not be sent earlier"},
      {"command", "{device}/command", client, no, one, "command",
       "A command for the device. Never retain it"},
      {"result", "{device}/result", agent, no, one, "result", "The result of each command"},
      {"link_command", "{link}/command", client, no, one, "link_command",
       "Frees the port of a link for another program, or takes it back. Never retain it"},
      {"link_result", "{link}/result", agent, no, one, "result",
       "The result of each command for a link"},
      {"desired", "config/desired", client, yes, one, "desired", "A remote config", true},
      {"reported", "config/reported", agent, yes, one, "reported", "The answer to a remote config",
       true},
  };
  return all;
}

std::vector<Place> places(const Config& config) {
  std::vector<Place> out;
  for (const Topic& topic : topics()) {
    if (topic.is_remote_config && !config.remote.enabled) continue;
    const std::string address = config.base_topic() + "/" + std::string(topic.address);
    if (topic.has("{device}")) {
      for (const DeviceConfig& device : config.devices) add_device(topic, address, device, out);
    } else if (topic.has("{link}")) {
      for (const LinkConfig& link : config.links)
        if (link.allow_yield)
          out.push_back({&topic, filled_in(address, "{link}", link.name), std::string(topic.schema),
                         nullptr, nullptr});
    } else {
      out.push_back({&topic, address, std::string(topic.schema), nullptr, nullptr});
    }
  }
  return out;
}

std::set<std::uint32_t> used_groups(const DeviceConfig& device) {
  std::set<std::uint32_t> used;
  for (const TagConfig& tag : device.tags) used.insert(tag.group);
  return used;
}

std::string schema_name(const DeviceConfig& device, std::string_view schema,
                        const GroupConfig* group) {
  std::string name = device.name + "." + std::string(schema);
  return group == nullptr ? name : name + "." + group->name;
}

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
