#include "agent/uplink/status/status_line.h"

#include <cstddef>
#include <cstdint>
#include <vector>

#include "agent/config/model.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

constexpr std::size_t kNamed = 3;

/// "links 1 of 2 up (line2 down)"
std::string counted(const std::string& what, std::size_t of, const std::string& state,
                    const std::vector<std::string>& others) {
  std::string text =
      what + " " + std::to_string(of - others.size()) + " of " + std::to_string(of) + " " + state;
  for (std::size_t i = 0; i < others.size() && i < kNamed; ++i)
    text += (i == 0 ? " (" : ", ") + others[i];
  if (others.size() > kNamed) text += " and " + std::to_string(others.size() - kNamed) + " more";
  return others.empty() ? text : text + ")";
}

std::string links(const AgentStatus& status) {
  const auto& links = status.config->links;
  std::size_t all = 0;
  std::vector<std::string> down;
  for (std::size_t i = 0; i < links.size(); ++i) {
    if (links[i].is_vacant()) continue;
    ++all;
    const LinkHealth link = i < status.field->links.size() ? status.field->links[i] : LinkHealth{};
    if (link.yielded || !link.open)
      down.push_back(links[i].name + (link.yielded ? " yielded" : " down"));
  }
  return counted("links", all, "up", down);
}

std::string devices(const AgentStatus& status) {
  const Config& config = *status.config;
  std::size_t all = 0;
  std::vector<std::string> others;
  for (std::size_t i = 0; i < config.devices.size(); ++i) {
    if (config.devices[i].is_vacant()) continue;
    ++all;
    const DeviceStatus* device = i < status.devices.size() ? status.devices[i].get() : nullptr;
    if (device != nullptr && device->state == DeviceStatus::State::online) continue;
    const std::string& name = config.devices[i].name;
    others.push_back(device == nullptr ? name + " starting"
                                       : name + " " + std::string(to_string(device->state)) + ": " +
                                             device->reason);
  }
  return counted("devices", all, "online", others);
}

std::string broker(const BrokerStatus& broker) {
  if (broker.connected) return "broker connected";
  const std::string since = " since " + utc_text(broker.since_ms);
  return "broker not connected" + since + (broker.why.empty() ? "" : ": " + broker.why);
}

std::string commands(const AgentStatus& status) {
  std::uint64_t all = 0;
  std::uint64_t unknown = 0;
  for (const auto& [outcome, count] : status.commands) {
    all += count;
    if (outcome == CommandStatus::unknown_outcome) unknown = count;
  }
  std::string text = std::to_string(all) + (all == 1 ? " command" : " commands");
  if (unknown > 0) text += ", " + std::to_string(unknown) + " UNKNOWN_OUTCOME";
  if (!status.broker.not_heard_why.empty())
    text += ", none are received: " + status.broker.not_heard_why;
  return text;
}

}  // namespace

std::string status_line(const AgentStatus& status) {
  std::string line;
  if (const auto& reload = status.config_status.last_reload; reload && reload->state == "rejected")
    line += "the config file has " + std::to_string(reload->errors_in_all) +
            (reload->errors_in_all == 1 ? " error" : " errors") + " and is not in force; ";
  if (!status.conflict.empty())
    line += "another agent (boot " + status.conflict + ") has the same id; ";
  line += links(status) + ", " + devices(status) + "; " + broker(status.broker);
  const std::uint64_t waiting = status.samples.stored;  // the others are about to be sent
  line += "; " + std::to_string(waiting) + (waiting == 1 ? " sample waits" : " samples wait");
  if (status.samples.dropped > 0)
    line += ", " + std::to_string(status.samples.dropped) + " dropped";
  if (!status.config->store.path.empty() && status.store_state == "memory")
    line += ", in memory: the disk refuses writes";
  if (status.store_state == "hangs") line += ", in memory: the disk does not respond";
  return line + "; " + commands(status);
}

}  // namespace fxagent
