// Names of the settings in the texts about a failed connection, which say what to set.
#pragma once

#include <string>

namespace fxagent {

/// By default those of the agent's config. A subcommand has options instead.
struct SettingNames {
  std::string servers = "mqtt.servers";
  std::string version = "mqtt.version";
  std::string user = "mqtt.username";
  std::string password_file = "password_file";
  std::string ca_file = "mqtt.tls.ca_file";
  std::string cert_file = "mqtt.tls.cert_file";
  std::string key_file = "key_file";
  /// Advice on a topic that the broker's access rules forbid.
  std::string access =
      "its access rules do not allow this for the agent's user; fxagent acl prints the rules that "
      "the agent needs";
};

}  // namespace fxagent
