// fxfleet: plays a fleet of agents against an MQTT broker. For usage see README.md.
// Exit status: 0 complete, 1 not all agents connected or not all messages acknowledged, 2 wrong
// usage, 3 this machine does not allow it.

#include <signal.h>
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <iostream>
#include <sstream>

#include "tests/fleet/fleet.h"

namespace {

constexpr rlim_t kOtherFiles = 64;

/// Raises the limit of open files. Returns false if the machine does not allow `files`.
bool raise_file_limit(rlim_t files) {
  rlimit limit{};
  getrlimit(RLIMIT_NOFILE, &limit);
  if (limit.rlim_cur >= files) return true;
  const rlimit wanted{files, std::max(limit.rlim_max, files)};
  if (setrlimit(RLIMIT_NOFILE, &wanted) == 0) return true;
  std::cerr << "fxfleet: " << files << " open files are needed, and this machine allows "
            << limit.rlim_max << ". Raise the hard limit (ulimit -Hn, or nofile in "
            << "/etc/security/limits.conf), or play fewer agents\n";
  return false;
}

asio::ip::tcp::endpoint endpoint(const std::string& text) {
  const auto colon = text.rfind(':');
  if (colon == std::string::npos) throw CLI::ValidationError("--broker", "expects HOST:PORT");
  asio::io_context io;
  asio::ip::tcp::resolver resolver(io);
  return resolver.resolve(asio::ip::tcp::v4(), text.substr(0, colon), text.substr(colon + 1))
      .begin()
      ->endpoint();
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Plays a fleet of fxagents against an MQTT broker, and prints figures as JSON"};
  fxfleet::FleetOptions options;
  std::vector<std::string> servers;
  int version = 5;
  int interval_ms = 1000;
  double spread_s = 0;
  double storm_at = 0;
  app.add_option("--agents", options.agents, "Number of agents (1000)")
      ->check(CLI::Range(1, 1000000));
  app.add_option("--interval-ms", interval_ms, "Time between two samples of an agent (1000)")
      ->check(CLI::Range(1, 3600000));
  app.add_option("--broker", servers, "HOST:PORT[,HOST:PORT...]: the servers of each agent, IPv4")
      ->required()
      ->delimiter(',');
  app.add_option("--seconds", options.seconds, "Seconds of steady load (10)");
  auto* storm =
      app.add_option("--storm-at", storm_at, "Kill the broker after this many of those seconds");
  app.add_option("--down", options.down_s, "Seconds from the kill to the restart (5)");
  app.add_option("--start", options.broker_command,
                 "Command that is the broker, such as \"mosquitto -c FILE\"; the storm kills it");
  app.add_option("--broker-log", options.broker_log, "File for the output of the commands");
  app.add_option("--storm-command", options.storm_command,
                 "Command that causes the storm, if the broker was started by another program");
  app.add_option("--commands", options.commands_per_second, "Commands a second (10)");
  app.add_option("--at-once", options.at_once, "First connects under way at a time (100)")
      ->check(CLI::PositiveNumber);
  app.add_option("--mqtt", version, "Version: 5, or 3 for 3.1.1 (5)")->check(CLI::IsMember({3, 5}));
  app.add_option("--qos", options.plan.qos, "QoS of samples (1)")->check(CLI::Range(0, 1));
  app.add_flag("--persistent", options.plan.keeps_session,
               "Sessions that outlive a connection, which fxagent does not use");
  app.add_option("--spread", spread_s, "mqtt.reconnect_spread_s of the agents (0)");
  app.add_option("--patience", options.patience_s, "Seconds until a phase is given up (300)");
  try {
    app.parse(argc, argv);
    for (const auto& server : servers) options.plan.servers.push_back(endpoint(server));
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const std::exception& error) {
    std::cerr << "fxfleet: --broker: " << error.what() << '\n';
    return 2;
  }
  options.plan.version = version == 5 ? fxfleet::Mqtt::v5 : fxfleet::Mqtt::v3;
  options.plan.interval = fxfleet::milliseconds(interval_ms);
  options.plan.spread = fxfleet::milliseconds(static_cast<long>(spread_s * 1000));
  if (storm->count() > 0) options.storm_at = storm_at;
  signal(SIGPIPE, SIG_IGN);
  if (!raise_file_limit(options.agents + kOtherFiles)) return 3;
  try {
    fxfleet::Fleet fleet(options);
    const auto report = fleet.run();
    std::cout << report.dump(1) << std::endl;
    return report["complete"].get<bool>() ? 0 : 1;
  } catch (const std::exception& error) {
    std::cerr << "fxfleet: " << error.what() << '\n';
    return 1;
  }
}
