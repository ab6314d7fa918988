// Reads the section `metrics` of the config file: the address that serves metrics.
#pragma once

#include <optional>

#include "agent/config/model.h"
#include "agent/config/read/reader.h"

namespace fxagent {

/// Reads the section at `node`. Warns if other machines can reach the address. Returns nullopt
/// after an error, which is reported to `reader`.
std::optional<MetricsConfig> read_metrics(ConfigReader& reader, const ConfigNode& node);

}  // namespace fxagent
