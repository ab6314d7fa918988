// The topics of the contract, section 3, and their addresses with a config; and the topics of the
// profiles that have a session of their own on the broker of `mqtt`. Pure, any thread.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config/model.h"

namespace fxagent::contract {

enum class Sender : std::uint8_t { agent, client };
enum class Retain : std::uint8_t { no, yes };
enum class Quality : std::uint8_t { one, as_configured };  ///< MQTT QoS: 1, or `mqtt.qos`

/// A topic with its placeholders: {device}, {group}, {link}.
struct Topic {
  std::string_view name;     ///< such as "device_state"
  std::string_view address;  ///< below {base}
  Sender sender = Sender::agent;
  Retain retain = Retain::no;
  Quality quality = Quality::one;
  std::string_view schema{};  ///< name of the schema of any agent's payloads
  std::string_view summary{};
  bool is_remote_config = false;  ///< only with `agent.remote_config`

  bool has(std::string_view placeholder) const { return address.find(placeholder) != address.npos; }
};
/// Returns all topics in the order of the contract.
const std::vector<Topic>& topics();

/// A topic of one agent.
struct Place {
  const Topic* topic = nullptr;
  std::string address{};  ///< whole topic
  std::string schema{};   ///< name of the schema of its payloads
  /// Null if the topic belongs to no device, or to no group.
  const DeviceConfig* device = nullptr;
  const GroupConfig* group = nullptr;
};
/// Returns the topics that the agent of this config uses: each device, each group that has tags,
/// and each link with `allow_yield`.
std::vector<Place> places(const Config& config);

/// Returns the indexes of the groups that have tags.
std::set<std::uint32_t> used_groups(const DeviceConfig& device);

/// Returns the name of the schema of one device or group: "press1.sample.fast".
std::string schema_name(const DeviceConfig& device, std::string_view schema,
                        const GroupConfig* group = nullptr);

/// Content type of most payloads.
inline constexpr std::string_view kJsonType = "application/json";

struct ProfileTopic {
  std::string_view name;  ///< "plain_value", unique in a config
  std::string address{};  ///< whole topic; {device}, {group}, {tag} and {object} stand for names
  std::string_view summary{};
  Sender sender = Sender::agent;
  Retain retain = Retain::no;
  int qos = 1;
  bool is_command = false;    ///< operators publish to it
  bool is_read_back = false;  ///< the agent also receives its own
  std::string_view content_type = kJsonType;

  /// Returns the filter for all names: a level with a placeholder is "+".
  std::string filter() const;
};
/// Returns the topics of the profiles on the broker of `mqtt`.
std::vector<ProfileTopic> profile_topics(const Config& config);

}  // namespace fxagent::contract
