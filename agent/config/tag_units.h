// Reads what the values of a tag mean: unit, description, labels of single values, limits.
#pragma once

#include "agent/config/config.h"
#include "agent/config/reader.h"

namespace fxagent {

/// Reads them from the members of the tag's object. `type`: the tag's; texts have neither limits
/// nor labels.
TagUnits read_tag_units(ConfigReader& reader, const ConfigNode& tag, DataType type);

}  // namespace fxagent
