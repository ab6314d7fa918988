// `fxagent fleet`: reads the retained topics of all agents of a broker, and sends configs to them.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "agent/config/model.h"

namespace fxagent {

struct FleetQuestion {
  std::string what;  ///< status or push
  std::string file;  ///< of push; {agent} stands for the name of each agent
  std::string broker;
  std::string root = "fx";  ///< agent.root of the configs
  std::string mqtt_version = "5";
  MqttConfig mqtt;  ///< user and password
  TlsSettings tls;
  std::vector<std::string> agents;
  bool all = false;
  std::size_t batch = 1;
  /// push: the time of each batch. status: the time without a message that counts as the end, if
  /// the broker does not let this user publish.
  std::optional<int> wait_s;
  bool confirmed = false;
  bool skip_offline = false;
  bool dry_run = false;
  bool as_json = false;
};

/// Prints its report to stdout. Exit status: 0 each agent is online and has the config that it was
/// sent, or accepted its document; 1 not so; 2 the call or a document is wrong, or the broker does
/// not answer (reason on stderr).
int run_fleet(const FleetQuestion& what);

}  // namespace fxagent
