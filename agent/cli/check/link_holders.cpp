#include "agent/cli/check/link_holders.h"

#include <algorithm>
#include <filesystem>
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

std::optional<OnlineHolder> holder_of(const Config& config, std::size_t index,
                                      const std::vector<RunningAgent>& agents,
                                      const std::string& command_id) {
  using Runs = OnlineHolder::Runs;
  const LinkConfig& link = config.links[index];
  for (const RunningAgent& agent : agents) {
    if (agent.runs_this)
      return OnlineHolder{agent.pid, "fxagent", Runs::this_config,
                          request_to(config, index, command_id)};
    if (!agent.config) continue;
    const auto& its_links = agent.config->links;
    const auto same = std::ranges::find_if(
        its_links, [&](const LinkConfig& its) { return is_same_place(link, its); });
    if (same == its_links.end()) continue;
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
