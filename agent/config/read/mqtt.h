// Reads the section `mqtt` of the config file, and the `brokers`, which have the same keys.
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>

#include "agent/config/model.h"
#include "agent/config/read/reader.h"
#include "agent/config/source.h"

namespace fxagent {

/// Returns "mqtt://host:port" with the port filled in, or the fault of the address.
tl::expected<std::string, std::string_view> normal_server(std::string_view server);

/// Reads the section at `node` into `config.mqtt`. `config.id` must be set. Reports faults to
/// `reader`; `privacy` decides if the file may contain a password.
void read_mqtt(ConfigReader& reader, const ConfigNode& node, Config& config, FilePrivacy privacy);
/// Same for the list of `brokers`.
void read_brokers(ConfigReader& reader, const ConfigNode& list, Config& config,
                  FilePrivacy privacy);

}  // namespace fxagent
