// Reads `devices` of the config file: groups, tags and command rules, checked against the protocol.
#pragma once

#include "agent/config/model.h"
#include "agent/config/read/links.h"
#include "agent/config/read/reader.h"

namespace fxagent {

/// Reads `devices`, with the `templates` of the file, into `config.devices`. Records the protocol
/// of each link in `links`. Reports faults to `reader`. A device with errors stays partly filled.
void read_devices(ConfigReader& reader, const ConfigNode& top, const ConfigNode& devices,
                  Links& links, Config& config);

/// Reads the meaning of the values of the tag at `tag`, which has type `type`: unit, description,
/// labels of single values, limits. Reports faults to `reader`: strings have neither limits nor
/// labels.
TagUnits read_tag_units(ConfigReader& reader, const ConfigNode& tag, DataType type);

}  // namespace fxagent
