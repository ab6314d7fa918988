#include "agent/cli/subcommands.h"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <functional>
#include <iostream>
#include <optional>
#include <set>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>

#include "agent/cli/exit_status.h"
#include "agent/cli/fleet/fleet.h"
#include "agent/cli/fleet/fleet_report.h"
#include "agent/cli/fleet/rollout.h"
#include "agent/cli/waiting_broker.h"
#include "agent/config/config_error.h"
#include "agent/config/read/sections.h"
#include "agent/config/source.h"
#include "agent/log/log.h"
#include "agent/remote/desired_config.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::seconds;

// Longer than the connect time-out of the MQTT library.
constexpr seconds kConnectPatience{35};
constexpr seconds kReadPatience{30};  // for subscriptions, and for all retained messages
constexpr seconds kQuiet{2};
constexpr seconds kBatchPatience{30};
constexpr seconds kTrialPatience{120};  // a trial takes 60 s
constexpr std::uint64_t kMarkerId = ~std::uint64_t{0};

/// Returns the names of the options for the connection.
SettingNames options() {
  return {.servers = "--broker",
          .version = "--mqtt-version",
          .user = "--user",
          .password_file = "--password-file",
          .ca_file = "--ca",
          .cert_file = "--cert",
          .key_file = "--key",
          .access =
              "its access rules do not allow this for this user; fxagent acl CONFIG "
              "--engineer NAME prints the rules of a user who may"};
}

MqttConfig connection_of(const FleetQuestion& what, const std::string& server) {
  MqttConfig mqtt = what.mqtt;
  mqtt.servers = {server};
  mqtt.version = what.mqtt_version == "5" ? 5 : 4;
  mqtt.client_id = "fxagent-fleet-" + random_digits();
  if (!what.tls.ca_file.empty() || !what.tls.cert_file.empty()) mqtt.tls = what.tls;
  return mqtt;
}

/// Reads the fleet from a broker, and publishes documents.
class FleetSession final {
 public:
  FleetSession(const MqttConfig& mqtt, std::string root, seconds quiet)
      : server_(mqtt.servers.at(0)),
        marker_(root + "/" + mqtt.client_id),
        quiet_(quiet),
        fleet_(std::move(root)),
        connection_(mqtt, kMaxDesiredBytes, options()) {}

  /// Connects and receives all retained messages of `names`, or of all agents if it is empty.
  /// Returns a fault, or an empty text.
  std::string read(const std::vector<std::string>& names) {
    filters_ = fleet_.filters(names);
    for (const std::string& name : names) fleet_.add(name);
    timer_ = Clock::now() + kConnectPatience;
    connection_.broker().connect(0, kReceiveMaximum);
    while (!is_read_ && fault_.empty()) {
      step(quiet_since_ ? std::min(timer_, *quiet_since_ + quiet_) : timer_);
      if (is_read_ || !fault_.empty()) break;
      if (quiet_since_ && Clock::now() >= *quiet_since_ + quiet_)
        is_read_ = true;
      else if (Clock::now() >= timer_)
        fault_ = server_ + ": no answer";
    }
    return fault_;
  }

  /// Sends each document and waits for its answer, until the rollout is over. Calls `progress`
  /// after each step of the rollout and at its end. Returns a fault, or an empty text.
  std::string push(Rollout& rollout, const std::function<void()>& progress) {
    rollout_ = &rollout;
    while (fault_.empty()) {
      const std::vector<std::size_t> due = rollout.advance(fleet_, Clock::now());
      progress();
      if (rollout.is_over()) break;
      for (const std::size_t i : due) {
        const Push& push = rollout.pushes()[i];
        Publication document = retained(fleet_.desired_topic(push.agent), push.document);
        document.id = i;
        connection_.broker().publish(std::move(document));
      }
      if (rollout.waits()) step(rollout.deadline());
    }
    rollout_ = nullptr;
    if (!fault_.empty()) {
      rollout.end(fleet_);
      progress();
    }
    return fault_;
  }

  const Fleet& fleet() const { return fleet_; }

 private:
  void step(SteadyTime deadline) {
    if (!connection_.wait_until(deadline)) {
      fault_ = "stopped by a signal";
      return;
    }
    for (const BrokerEvent& event : connection_.broker().take_events())
      std::visit([this](const auto& e) { on(e); }, event);
  }

  void on(const Connected&) {
    timer_ = Clock::now() + kReadPatience;
    filters_.push_back(marker_);
    subscribe();
  }
  void on(const ConnectFailed& event) { fault_ = server_ + ": " + event.text; }
  void on(const Subscribed& event) {
    timer_ = Clock::now() + kReadPatience;
    if (event.filter == marker_) marker_granted_ = event.granted;
    // A viewer may not read what is desired. The reports alone still say what is in force.
    else if (!event.granted && !event.filter.ends_with(kDesiredTopic))
      fault_ = server_ + ": the broker refuses " + event.filter + ": " + event.text;
    if (++subscribed_ < filters_.size()) return subscribe();
    // The broker sends this message after the retained messages, because all go through one
    // queue. If the user may not receive it, or it has not come by its acknowledgement, a quiet
    // time is the end.
    if (!marker_granted_) {
      quiet_since_ = Clock::now();
      return;
    }
    connection_.broker().publish({.id = kMarkerId, .topic = marker_, .payload = "end"});
  }
  void on(const Message& event) {
    if (event.topic == marker_) {
      is_read_ = true;
      return;
    }
    timer_ = Clock::now() + kReadPatience;
    if (quiet_since_) quiet_since_ = Clock::now();
    fleet_.take(event.topic, event.payload);
  }
  void on(const Lost& event) { fault_ = server_ + ": lost: " + event.text; }
  void on(const MessagesDropped& event) {
    fault_ = "this program was too slow: " + std::to_string(event.count) + " messages were dropped";
  }
  void on(const DeliveryFailed& event) {
    if (event.id == kMarkerId)
      quiet_since_ = Clock::now();
    else if (rollout_ != nullptr)
      rollout_->not_accepted(event.id, "the broker did not accept the message: " + event.text);
  }
  void on(const Disconnected&) {}
  void on(const Delivered& event) {
    if (event.id == kMarkerId) quiet_since_ = Clock::now();
  }

  void subscribe() {
    connection_.broker().subscribe({filters_.at(subscribed_), /*no_local=*/false});
  }

  const std::string server_;
  const std::string marker_;  ///< topic of the message that ends the retained ones
  const seconds quiet_;
  Fleet fleet_;
  std::vector<std::string> filters_;  ///< one after the other; the marker's comes last
  std::size_t subscribed_ = 0;
  bool marker_granted_ = false;
  bool is_read_ = false;
  SteadyTime timer_ = SteadyTime::max();
  std::optional<SteadyTime> quiet_since_;  ///< set once the marker may not come
  std::string fault_;
  Rollout* rollout_ = nullptr;
  WaitingBroker connection_;  // last, so that it is destroyed first
};

/// Reads the document of an agent, or returns what is wrong with it.
tl::expected<Push, std::string> document_for(const std::string& agent, std::string path) {
  constexpr std::string_view kName = "{agent}";
  for (auto at = path.find(kName); at != path.npos; at = path.find(kName, at + agent.size()))
    path.replace(at, kName.size(), agent);
  auto document = read_config_file(path);
  if (!document) return tl::unexpected(to_string(document.error().front(), path));
  const ReadDesired read = read_desired(*document);
  std::string faults;
  for (const ConfigError& error : read.errors)
    faults += (faults.empty() ? "" : "\n") + to_string(error, path);
  if (!faults.empty()) return tl::unexpected(faults);
  return Push{.agent = agent,
              .document = *std::move(document),
              .version = read.desired.version,
              .hash = read.desired.hash};
}

/// Returns what is wrong with the call; empty: nothing.
std::string fault_of(const FleetQuestion& what) {
  if (what.root.empty() || what.root.find_first_of("+#") != what.root.npos ||
      what.root.ends_with('/') || what.root.starts_with('$'))
    return "--root must be a topic without wildcards, as agent.root of the configs";
  std::set<std::string> seen;
  for (const std::string& name : what.agents) {
    if (!is_name(name)) return "--agents: \"" + name + "\" is not the name of an agent";
    if (!seen.insert(name).second) return "--agents names " + name + " twice";
  }
  if (what.tls.cert_file.empty() != what.tls.key_file.empty())
    return "--cert and --key belong together";
  if (what.what == "status") {
    if (!what.file.empty() || what.confirmed || what.skip_offline || what.dry_run)
      return "status takes no FILE, --confirmed, --skip-offline or --dry-run";
    return {};
  }
  if (what.file.empty()) return "push needs a FILE";
  if (what.all != what.agents.empty()) return "push needs either --agents or --all";
  return {};
}

int status(const FleetQuestion& what, FleetSession& session) {
  if (const std::string fault = session.read(what.agents); !fault.empty())
    return refused("fleet", fault);
  std::cout << (what.as_json ? fleet_json(session.fleet()) : fleet_text(session.fleet()));
  return is_fleet_good(session.fleet()) ? kDone : kFailed;
}

/// Reads all documents. Prints each fault to stderr and returns nullopt if there is one.
std::optional<std::vector<Push>> documents(const std::vector<std::string>& agents,
                                           const std::string& file) {
  std::vector<Push> pushes;
  bool good = true;
  for (const std::string& agent : agents) {
    auto push = document_for(agent, file);
    if (push)
      pushes.push_back(std::move(*push));
    else
      good = false, refused("fleet", push.error());
    // The same file for all has the same faults.
    if (!good && file.find("{agent}") == file.npos) break;
  }
  if (!good) return std::nullopt;
  return pushes;
}

int push(const FleetQuestion& what, FleetSession& session) {
  // Named agents: nothing is asked of the broker until each document is right.
  std::optional<std::vector<Push>> pushes;
  if (!what.all && !(pushes = documents(what.agents, what.file))) return kWrong;
  if (const std::string fault = session.read(what.agents); !fault.empty())
    return refused("fleet", fault);
  if (what.all) {
    std::vector<std::string> names;
    for (const auto& [name, agent] : session.fleet().agents())
      if (is_name(name)) names.push_back(name);
    if (names.empty()) return refused("fleet", "no agent was found", kFailed);
    pushes = documents(names, what.file);
    if (!pushes) return kWrong;
  }
  const RolloutRules rules{.batch = what.batch,
                           .patience = what.wait_s      ? seconds(*what.wait_s)
                                       : what.confirmed ? kTrialPatience
                                                        : kBatchPatience,
                           .confirmed = what.confirmed,
                           .skip_offline = what.skip_offline};
  if (what.dry_run) {
    std::cout << dry_run_text(*pushes, rules, session.fleet());
    return is_dry_run_good(*pushes, rules, session.fleet()) ? kDone : kFailed;
  }
  Rollout rollout(std::move(*pushes), rules);
  RolloutLines lines(rollout);
  const std::string fault = session.push(rollout, [&] {
    if (!what.as_json) std::cout << lines.take() << std::flush;
  });
  if (!fault.empty()) refused("fleet", fault);
  std::cout << (what.as_json ? rollout_json(rollout, fault) : rollout_sum(rollout));
  if (!fault.empty()) return kWrong;
  return rollout.is_good() ? kDone : kFailed;
}

}  // namespace

int run_fleet(const FleetQuestion& what) {
  log::set_level(log::Level::error);
  if (const std::string fault = fault_of(what); !fault.empty()) return refused("fleet", fault);
  const auto server = normal_server(what.broker);
  if (!server) return refused("fleet", "--broker " + std::string(server.error()));
  const bool is_push = what.what == "push";
  const seconds quiet = what.wait_s && !is_push ? seconds(*what.wait_s) : kQuiet;
  FleetSession session(connection_of(what, *server), what.root, quiet);
  return is_push ? push(what, session) : status(what, session);
}

}  // namespace fxagent
