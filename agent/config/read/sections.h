// Reads sections of the config file: `mqtt` and `brokers` (mqtt.cpp), `http` and `metrics`
// (http.cpp), `devices` (devices/), `profiles` (profiles.cpp), and the limits of remote configs in
// `agent` (remote_limits.cpp). Each function reports faults to its reader.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>

#include "agent/config/model.h"
#include "agent/config/read/reader.h"
#include "agent/config/source.h"

namespace fxagent {

struct Links;

/// Returns "mqtt://host:port" with the port filled in, or the fault of the address.
tl::expected<std::string, std::string_view> normal_server(std::string_view server);

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

}  // namespace fxagent
