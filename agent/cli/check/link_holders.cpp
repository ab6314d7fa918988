#include "agent/cli/check/link_holders.h"

#include <arpa/inet.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <system_error>
#include <utility>

#include "agent/config/loader.h"
#include "agent/process/port_access.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

/// True if both name one serial port, or one host and port.
bool is_same_place(const LinkConfig& one, const LinkConfig& other) {
  const auto* serial = std::get_if<SerialSettings>(&one.channel);
  const auto* its_serial = std::get_if<SerialSettings>(&other.channel);
  if (serial == nullptr || its_serial == nullptr) return place_of(one) == place_of(other);
  std::error_code missing;
  return serial->path == its_serial->path ||
         std::filesystem::equivalent(serial->path, its_serial->path, missing);
}

/// An agent that runs on this machine.
struct RunningAgent {
  int pid = 0;
  bool runs_this = false;          ///< the file of the config, whatever is in it by now
  std::optional<Config> config{};  ///< of another file; nullopt: it cannot be read
};

std::vector<RunningAgent> running_agents(const std::string& path) {
  std::vector<RunningAgent> agents;
  for (const CalledProcess& process : processes_called("fxagent", "run")) {
    RunningAgent& agent = agents.emplace_back(process.pid);
    for (const std::string& file : process.files) {
      std::error_code unseen;
      if (std::filesystem::equivalent(file, path, unseen)) agent.runs_this = true;
      if (agent.runs_this || agent.config) break;
      if (auto config = load_config(file)) agent.config = std::move(*config);
    }
  }
  return agents;
}

/// True if the agent does not use the link: another process or none has the serial port; or the
/// agent has freed the link by the command `yield`, and has no connection to the device. Compares
/// IPv4 addresses with their port, other hosts by the port alone.
bool leaves_alone(const RunningAgent& agent, const LinkConfig& link) {
  const std::string place = endpoint_of(link);
  if (std::holds_alternative<SerialSettings>(link.channel)) {
    const auto holder = port_holder(place);
    return !holder || holder->pid != agent.pid;
  }
  if (!link.allow_yield) return false;
  const std::size_t colon = place.rfind(':');
  in_addr host{};
  const bool is_ipv4 = ::inet_pton(AF_INET, place.substr(0, colon).c_str(), &host) == 1;
  std::array<char, 32> device{};  // as the kernel spells it: "0200C00A:01F6"
  const auto port = number_from<unsigned>(place.substr(colon + 1)).value_or(0);
  if (is_ipv4)
    std::snprintf(device.data(), device.size(), "%08X:%04X", host.s_addr, port);
  else
    std::snprintf(device.data(), device.size(), ":%04X", port);
  for (const char* table : {"tcp", "tcp6", "udp", "udp6"}) {
    std::ifstream rows("/proc/" + std::to_string(agent.pid) + "/net/" + table);
    if (!rows) return false;
    std::string number, own, its, state, rest;
    while (rows >> number >> own >> its >> state && std::getline(rows, rest))
      if (state == "01" && its.ends_with(device.data())) return false;  // connected
  }
  return true;
}

std::optional<OnlineHolder> holder_of(const Config& config, std::size_t index,
                                      const std::vector<RunningAgent>& agents,
                                      const std::string& command_id) {
  using Runs = OnlineHolder::Runs;
  const LinkConfig& link = config.links[index];
  for (const RunningAgent& agent : agents) {
    if (agent.runs_this && !leaves_alone(agent, link))
      return OnlineHolder{agent.pid, "fxagent", Runs::this_config,
                          request_to(config, index, command_id)};
    if (!agent.config) continue;
    const auto& its_links = agent.config->links;
    const auto same = std::ranges::find_if(
        its_links, [&](const LinkConfig& its) { return is_same_place(link, its); });
    if (same == its_links.end() || leaves_alone(agent, *same)) continue;
    OnlineHolder holder{agent.pid, "fxagent", Runs::another_config};
    if (agent.config->base_topic() == config.base_topic())
      holder.request =
          request_to(*agent.config, static_cast<std::size_t>(same - its_links.begin()), command_id);
    return holder;
  }
  const auto* serial = std::get_if<SerialSettings>(&link.channel);
  const auto holder = serial == nullptr ? std::nullopt : port_holder(serial->path);
  if (!holder) return std::nullopt;
  const bool is_agent = holder->program == "fxagent";
  return OnlineHolder{holder->pid, holder->program,
                      is_agent ? Runs::another_config : Runs::no_agent};
}

}  // namespace

std::string place_of(const LinkConfig& link) {
  return (std::holds_alternative<UdpSettings>(link.channel) ? "udp " : "") + endpoint_of(link);
}

std::vector<std::optional<OnlineHolder>> link_holders(const Config& config,
                                                      const std::string& path) {
  const auto agents = running_agents(path);
  const std::string command_id = "check-" + random_digits();
  std::vector<std::optional<OnlineHolder>> holders;
  for (std::size_t i = 0; i < config.links.size(); ++i)
    holders.push_back(holder_of(config, i, agents, command_id));
  return holders;
}

}  // namespace fxagent
