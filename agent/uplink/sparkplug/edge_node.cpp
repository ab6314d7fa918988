#include "agent/uplink/sparkplug/edge_node.h"

#include <utility>

namespace fxagent::sparkplug {

EdgeNode::EdgeNode(const Config& config, const ProfileConfig& profile, const std::string& version,
                   PrimaryHost host, TakeOrder take_order, std::function<std::int64_t()> utc_ms)
    : config_(config),
      name_(name_of(profile)),
      prefix_(version + "/" + profile.group + "/"),
      node_(profile.node),
      take_order_(std::move(take_order)),
      utc_ms_(std::move(utc_ms)),
      births_(config, profile.broker, std::move(host)) {}

Will EdgeNode::last_will() {
  births_.begin_session();
  const Publication death = node_death(utc_ms_());
  return {death.topic, death.payload, Retain::no};
}

std::vector<Publication> EdgeNode::farewell(std::int64_t utc_ms) {
  if (!births_.is_born()) return {};
  return {node_death(utc_ms)};
}

Publication EdgeNode::message(std::string_view type, const std::string& device,
                              std::string payload) const {
  return {.topic = prefix_ + std::string(type) + "/" + node_ + (device.empty() ? "" : "/" + device),
          .payload = std::move(payload),
          .qos = 0};
}

}  // namespace fxagent::sparkplug
