// The text of a config file and the permissions of the file.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>

#include "agent/config/config_error.h"

namespace fxagent {

/// Returns the value of a variable for `${NAME}`; nullopt if it is not set.
using Environment = std::function<std::optional<std::string>(std::string_view name)>;

/// Read permissions of the config file. A file that users other than its owner can read must not
/// contain a password, unless `allow_plain_secret` is set.
enum class FilePrivacy : std::uint8_t { shared, owner_only };

/// Returns the current state of the file. A missing file counts as shared.
FilePrivacy privacy_of(const std::string& path);

/// Returns the text of the file, cut a little above the largest size of a config.
tl::expected<std::string, ConfigErrors> read_config_file(const std::string& path);

}  // namespace fxagent
