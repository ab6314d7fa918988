// Reads `devices` of the config file: groups, tags and command rules, checked against the protocol.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "agent/config/model.h"
#include "agent/config/read/links.h"
#include "agent/config/read/reader.h"

namespace fxagent {

/// Reads `devices`, with the `templates` of the file, into `config.devices`. Records the protocol
/// of each link in `facts`. Reports faults to `reader`. A device with errors stays partly filled.
void read_devices(ConfigReader& reader, const ConfigNode& top, const ConfigNode& devices,
                  const NameTable& links, std::vector<LinkFacts>& facts, Config& config);

}  // namespace fxagent
