// Who can read a config file, apart from its text: whoever keeps the text keeps this beside it.
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "agent/config/config.h"

namespace fxagent {

/// As the file is at this moment. One that is not there is shared.
FilePrivacy privacy_of(const std::string& path);

/// config_of_file() for a text that was read when the file had these rights. Looks at no file.
tl::expected<Config, std::vector<ConfigError>> config_of_file(const std::string& path,
                                                              std::string_view text,
                                                              FilePrivacy privacy);

}  // namespace fxagent
