// JSON text as people write it: what fits stands on one line, the rest one member a line.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "agent/config/tree.h"

namespace fxagent {

/// The text in quotes, with escapes.
void append_json_string(std::string& out, std::string_view text);

/// The node with all below it; folded arrays come out empty. `depth`: brackets around it.
void append_pretty(std::string& out, const ConfigNode& node, std::size_t depth);

/// The same JSON with its numbers as they are spelled; empty where it is none.
std::string pretty_text(std::string_view json);

}  // namespace fxagent
