// Reads the meaning of a tag's values: unit, description, labels of single values, limits.
#pragma once

#include "agent/config/model.h"
#include "agent/config/read/reader.h"

namespace fxagent {

/// Reads the TagUnits of the tag at `tag`, which has type `type`. Reports faults to `reader`:
/// strings have neither limits nor labels.
TagUnits read_tag_units(ConfigReader& reader, const ConfigNode& tag, DataType type);

}  // namespace fxagent
