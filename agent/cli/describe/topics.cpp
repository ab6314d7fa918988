#include "agent/cli/describe/topics.h"

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

}  // namespace fxagent::contract
