#include "agent/cli/subcommands.h"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <iostream>
#include <optional>
#include <semaphore>
#include <system_error>
#include <utility>
#include <vector>

#include "agent/cli/check/online_report.h"
#include "agent/cli/waiting_broker.h"
#include "agent/config/loader.h"
#include "agent/field/field.h"
#include "agent/handover/outbox.h"
#include "agent/log/log.h"
#include "agent/process/port_access.h"
#include "agent/text/text.h"
#include "agent/uplink/paho/paho_broker.h"
#include "agent/uplink/topics.h"

namespace fxagent {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds kGoodbye{2};
// The check ends after this time without a sample or state from any device.
constexpr std::chrono::minutes kFieldPatience{5};
// Polls each group once: the next cycle lies beyond the end of any check.
constexpr std::chrono::hours kNeverAgain{24};
constexpr std::size_t kMostSamples = 100'000;

// ---- links --------------------------------------------------------------------------------------

std::string place_of(const LinkConfig& link) {
  return (std::holds_alternative<UdpSettings>(link.channel) ? "udp " : "") + endpoint_of(link);
}

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
  bool runs_this = false;          ///< the checked file, whatever is in it by now
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

/// Returns the holder of a link; nullopt if it is free. An agent that runs the checked file holds
/// all its links; one of another file those of the same place.
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

std::vector<OnlineLink> links_of(const Config& config, const std::string& path) {
  const auto agents = running_agents(path);
  const std::string command_id = "check-" + random_digits();
  std::vector<OnlineLink> links;
  for (const LinkConfig& link : config.links)
    links.push_back({.name = link.name, .place = place_of(link)});
  for (const DeviceConfig& device : config.devices) {
    OnlineLink& link = links[device.link];
    if (link.holder) continue;
    link.holder = holder_of(config, device.link, agents, command_id);
    if (link.holder) link.state = OnlineLink::State::held;
  }
  return links;
}

// ---- devices ------------------------------------------------------------------------------------

/// Reduces the config to the given devices, each polled once.
Config narrowed(const Config& config, const std::vector<std::uint32_t>& devices) {
  Config only = config;
  // Vacant without a name.
  for (LinkConfig& link : only.links) link.name.clear();
  for (DeviceConfig& device : only.devices) device.name.clear();
  for (const std::uint32_t index : devices) {
    DeviceConfig& device = only.devices[index];
    device.name = config.devices[index].name;
    only.links[device.link].name = config.links[device.link].name;
    device.retries = 0;
    for (GroupConfig& group : device.groups) {
      group.interval = kNeverAgain;
      group.on_change = false;
    }
  }
  return only;
}

/// Polls each group of these devices once, as the agent would.
void ask(const Config& config, const std::vector<std::uint32_t>& devices, OnlineDevices& answers) {
  for (const std::uint32_t device : devices) answers.ask(device);
  if (devices.empty()) return;
  Outbox outbox(kMostSamples);
  Field field(narrowed(config, devices), outbox, {});
  field.start();
  auto deadline = Clock::now() + kFieldPatience;
  while (!answers.settled() && Clock::now() < deadline) {
    outbox.wait_until(deadline);
    const auto batch = outbox.take();
    for (const DeviceStatus& status : batch.states) answers.take(status);
    for (const Telemetry& sample : batch.telemetry) answers.take(sample);
    if (!batch.states.empty() || !batch.telemetry.empty()) deadline = Clock::now() + kFieldPatience;
  }
}

// ---- brokers ------------------------------------------------------------------------------------

/// Rights of the agent's user that the check tries at a broker.
struct TriedRights {
  std::vector<std::string> filters;  ///< to subscribe to
  /// To publish on, without harm: a response topic that no command has named. Empty: on none.
  std::string topic{};
};

/// Connects to one server and tries the rights that the agent needs.
class BrokerLook final {
 public:
  BrokerLook(const MqttConfig& mqtt, std::size_t server, TriedRights rights)
      : rights_(std::move(rights)),
        found_{.server = mqtt.servers[server]},
        broker_(mqtt, /*make_will=*/{}, [this] { news_.release(); }) {
    broker_.connect(server, kReceiveMaximum);
  }

  OnlineBroker run() {
    listen_until(Clock::now() + kBrokerPatience);
    if (!over_) found_.text = "no answer" + tried(" to ");
    if (!found_.connected) return std::move(found_);
    over_ = false;
    broker_.disconnect();
    listen_until(Clock::now() + kGoodbye);
    return std::move(found_);
  }

 private:
  void listen_until(SteadyTime deadline) {
    while (!over_ && news_.try_acquire_until(deadline))
      for (const BrokerEvent& event : broker_.take_events())
        std::visit([this](const auto& e) { on(e); }, event);
  }
  void on(const Connected&) {
    found_.connected = true;
    try_next();
  }
  void on(const ConnectFailed& event) { end(event.text); }
  void on(const Lost& event) {
    end("it closed the connection" + tried(" after ") + ": " + event.text);
  }
  void on(const Subscribed& event) {
    if (!event.granted) refuses("subscribe to " + event.filter, event.text);
    try_next();
  }
  void on(const Delivered&) { try_next(); }
  void on(const DeliveryFailed& event) {
    refuses("publish on " + rights_.topic + ", a response topic", event.text);
    try_next();
  }
  void on(const Disconnected&) { over_ = true; }
  void on(const auto&) {}

  void try_next() {
    const std::size_t at = tried_++;
    if (at < rights_.filters.size())
      broker_.subscribe({rights_.filters[at], /*no_local=*/false});
    else if (at == rights_.filters.size() && !rights_.topic.empty())
      publish();
    else
      end({});
  }
  void publish() {
    found_.is_publishing_tried = true;
    broker_.publish({.topic = rights_.topic});
  }
  /// Returns `before` and the last right that was tried; empty: none was.
  std::string tried(const std::string& before) const {
    if (found_.is_publishing_tried) return before + "a message on " + rights_.topic;
    if (tried_ == 0 || tried_ > rights_.filters.size()) return {};
    return before + "a subscription to " + rights_.filters[tried_ - 1];
  }
  void refuses(const std::string& right, const std::string& why) {
    found_.refused.push_back(right + " (" + why + ")");
  }
  void end(const std::string& text) {
    over_ = true;
    if (found_.text.empty()) found_.text = text;
  }

  const TriedRights rights_;
  std::size_t tried_ = 0;  ///< number of rights tried; the topic comes after the filters
  OnlineBroker found_;
  bool over_ = false;
  std::counting_semaphore<> news_{0};
  PahoBroker broker_;  // last: its callbacks use the semaphore
};

/// Looks at each server of `mqtt`.
void look_at(MqttConfig mqtt, TriedRights rights, std::vector<OnlineBroker>& found) {
  // Uses its own client id: the agent's id would disconnect the running agent.
  mqtt.client_id += "-check-" + random_digits();
  if (mqtt.version != 5) rights.topic.clear();  // MQTT 3.1.1 acknowledges what it refuses
  for (std::size_t i = 0; i < mqtt.servers.size(); ++i)
    found.emplace_back(BrokerLook(mqtt, i, rights).run());
}

std::vector<OnlineBroker> online_brokers(const Config& config) {
  const std::string base = config.base_topic();
  const std::string commands = base + "/+/command";
  TriedRights own{{commands}};
  if (!config.devices.empty())
    own.topic =
        base + "/" + std::string(config.devices.front().name) + "/result/check-" + random_digits();
  if (config.remote.enabled) own.filters.push_back(base + std::string(kDesiredTopic));
  if (config.pair)
    for (const std::string_view topic : kPairTopics)
      own.filters.push_back(base + "/" + std::string(topic));
  std::vector<OnlineBroker> found;
  look_at(config.mqtt, own, found);
  for (const BrokerConfig& broker : config.brokers) {
    const bool has_json = std::ranges::any_of(config.profiles, [&](const ProfileConfig& profile) {
      return profile.kind == ProfileConfig::Kind::json && profile.broker == broker.name;
    });
    const auto first = std::ssize(found);
    // No publishing: a message on a response topic would do no harm, but json has none there.
    look_at(broker.mqtt, has_json && broker.commands ? TriedRights{{commands}} : TriedRights{},
            found);
    for (auto it = found.begin() + first; it != found.end(); ++it)
      it->sends_commands = broker.commands;
  }
  return found;
}

}  // namespace

int run_online_check(const Config& config, const std::string& path, bool as_json) {
  log::set_level(log::Level::error);
  std::signal(SIGPIPE, SIG_IGN);
  OnlineFindings findings;
  findings.path = path;
  findings.links = links_of(config, path);
  findings.brokers = online_brokers(config);

  OnlineDevices devices(config);
  std::vector<std::uint32_t> free_ones;
  for (std::uint32_t i = 0; i < config.devices.size(); ++i)
    if (!findings.links[config.devices[i].link].holder) free_ones.push_back(i);
  ask(config, free_ones, devices);
  ask(config, devices.worth_another_try(), devices);
  findings.devices = devices.found();
  judge_links(config, findings);

  std::cout << (as_json ? online_json(config, findings) : online_text(config, findings));
  return exit_status(findings);
}

}  // namespace fxagent
