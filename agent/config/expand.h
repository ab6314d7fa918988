// Writes a config file with every device in full: no templates, no `n`.
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "agent/config/source.h"

namespace fxagent {

/// Returns the file as JSON text with the same meaning. Leaves `${NAME}` and secrets unchanged, and
/// drops comments. Errors: those of load_config().
tl::expected<std::string, std::vector<ConfigError>> expanded_config(const std::string& path);
/// Same for a text in memory, which must be a valid config in this environment.
std::string expanded_config(std::string_view text, const Environment& environment);

}  // namespace fxagent
