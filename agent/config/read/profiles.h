// Reads the section `profiles` of the config file.
#pragma once

#include "agent/config/model.h"
#include "agent/config/read/reader.h"

namespace fxagent {

/// Reads the list at `list` into `config.profiles`. Reports faults to `reader`. Call when the
/// brokers and devices of `config` are read: each tag must have a topic of its own.
void read_profiles(ConfigReader& reader, const ConfigNode& list, Config& config);

}  // namespace fxagent
