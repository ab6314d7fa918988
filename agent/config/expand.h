// A config file with every device written out: no templates, no `n`.
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "agent/config/config.h"

namespace fxagent {

/// The file as JSON text that means the same. `${NAME}` stays as it stands, and so do secrets.
/// Errors: those of the file, as load_config() has them.
tl::expected<std::string, std::vector<ConfigError>> expanded_config(const std::string& path);
/// The same on a text already in memory, which must be a right config in this environment.
std::string expanded_config(std::string_view text, const Environment& environment);

}  // namespace fxagent
