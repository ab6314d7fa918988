// The section `metrics` of the config file: the address where metrics are served.
#pragma once

#include <optional>

#include "agent/config/config.h"
#include "agent/config/reader.h"

namespace fxagent {

/// Warns of an address that others than this machine can reach. Nullopt: there was an error.
std::optional<MetricsConfig> read_metrics(ConfigReader& reader, const ConfigNode& node);

}  // namespace fxagent
