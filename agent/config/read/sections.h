// Reads sections of the config file: `mqtt` and `brokers` (mqtt.cpp), `http` and `metrics`
// (http.cpp), `links` (links.cpp), `devices` (devices/), `profiles` (profiles.cpp), and the limits
// of remote configs in `agent` (remote_limits.cpp). Warns of settings that are allowed and probably
// a mistake (warnings.cpp). Each function reports faults to its reader.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>
#include <vector>

#include "agent/config/model.h"
#include "agent/config/read/reader.h"
#include "agent/config/source.h"

namespace fxagent {

class DeviceEntry;

/// Returns "mqtt://host:port" with the port filled in, or the fault of the address.
tl::expected<std::string, std::string_view> normal_server(std::string_view server);
/// True if a result of normal_server() names this machine.
bool is_on_this_machine(std::string_view server);

/// Reads the section at `node` into `config.mqtt`. `config.id` must be set. `privacy` decides if
/// the file may contain a password.
void read_mqtt(ConfigReader& reader, const ConfigNode& node, Config& config, FilePrivacy privacy);
/// Same for the list of `brokers`, which have the same keys.
void read_brokers(ConfigReader& reader, const ConfigNode& list, Config& config,
                  FilePrivacy privacy);

/// Reads `http` or `metrics` of the file at `top`, of which it may have one: the address of the
/// HTTP server. Warns if other machines can reach the address. Returns nullopt if there is none,
/// and after an error.
std::optional<HttpConfig> read_http(ConfigReader& reader, const ConfigNode& top);

/// State of one link while the devices are read. There is one for each link of the config.
struct LinkFacts {
  std::string_view channel;  ///< "serial", "tcp" or "udp"; empty if the link has an error
  /// Node with the keys of the serial line; nullptr if the link has none.
  const ConfigNode* line = nullptr;
  /// Protocol of the first device on the link, which all others must have too; nullptr until then.
  const ProtocolInfo* protocol = nullptr;
  const ConfigNode* first_device = nullptr;
};

/// The links while the file is read, in its order.
struct Links {
  NameTable names;
  std::vector<LinkFacts> facts;
};

/// Reads the links at `array` into `config.links`.
Links read_links(ConfigReader& reader, const ConfigNode& array, Config& config);

/// Sets `device.link` to the link that the entry names. Checks that the link's channel and its
/// other devices allow the protocol, and records it in `links.facts`.
void join_link(ConfigReader& reader, const DeviceEntry& entry, Links& links, DeviceConfig& device);

/// Reads the settings of the serial lines, of which the protocol supplies missing ones. Call it
/// when the devices are known. Warns of links without devices and of unusual line settings.
void finish_links(ConfigReader& reader, const ConfigNode& array, const Links& links,
                  Config& config);

/// Sets the silences that guard against late replies: the time that each link listens before its
/// first request, and the gap before requests on UDP.
void set_silences(Config& config);

/// Reads `devices`, with the `templates` of the file, into `config.devices`. Records the protocol
/// of each link in `links`. A device with errors stays partly filled.
void read_devices(ConfigReader& reader, const ConfigNode& top, const ConfigNode& devices,
                  Links& links, Config& config);
/// Reads the meaning of the values of the tag at `tag`, which has type `type`: unit, description,
/// labels of single values, limits. Strings have neither limits nor labels.
TagUnits read_tag_units(ConfigReader& reader, const ConfigNode& tag, DataType type);

/// Reads the list at `list` into `config.profiles`. Call when the brokers and devices of `config`
/// are read: each tag must have a topic of its own.
void read_profiles(ConfigReader& reader, const ConfigNode& list, Config& config);

/// Reads `remote_config`, `remote_allow` and `remote_without_disk` of the section `agent`.
RemoteLimits read_remote_limits(ConfigReader& reader, const ConfigNode& agent);
/// Returns the limits as `check` prints them: "links, devices, commands.allow D300-D399".
std::string to_string(const RemoteLimits& limits);

/// Warns if `min` or `max` of the tag at `node` is beyond the range of its type, if they leave one
/// value or none, or if `deadband` is larger than the range.
void warn_of_limits(ConfigReader& reader, const ConfigNode& node, const TagConfig& tag);

/// Warns if the list `allow` of the device covers a place of a tag with `min` or `max`: a command
/// to the address is not checked against them. Once, at the first such tag. The device has a codec.
void warn_of_unchecked_limits(ConfigReader& reader, const ConfigNode& allow,
                              const DeviceConfig& device);

/// Warns if `max_silent_s` of the group at `node` is below its poll interval: every poll is
/// published then.
void warn_of_silence(ConfigReader& reader, const ConfigNode& node, const GroupConfig& group);

/// Warns of a speed or character format that the documents of the protocol or model do not list.
/// `config.links` was read from the array `links`; `lines` are their settings, with 0 baud if they
/// are unknown.
void warn_of_lines(ConfigReader& reader, const ConfigNode& links,
                   std::span<const SerialSettings> lines, const Config& config);

/// Entry of the first device with a station or unit, by link and number.
using FirstStations = std::map<std::pair<std::uint32_t, std::int64_t>, const ConfigNode*>;
/// Adds the station or unit of the device. Warns if an earlier device on the link has it.
void warn_of_station(ConfigReader& reader, const DeviceEntry& entry, const DeviceConfig& device,
                     FirstStations& stations);

}  // namespace fxagent
