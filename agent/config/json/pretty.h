// Formats JSON text: a value that fits is on one line, larger ones have one member per line.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "agent/config/json/tree.h"

namespace fxagent {

/// Appends `"key": `, escaped.
void append_key(std::string& out, std::string_view key);

/// Appends the node and its children; folded arrays come out empty. `depth` is the number of
/// brackets around it.
void append_pretty(std::string& out, const ConfigNode& node, std::size_t depth);

/// Returns `json` formatted. Returns an empty string if it is not valid JSON.
std::string pretty_text(std::string_view json);

}  // namespace fxagent
