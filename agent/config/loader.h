// Reads a config file into the model.
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>

#include "agent/config/model.h"
#include "agent/config/read/config_limits.h"
#include "agent/config/source.h"
#include "agent/process/this_process.h"

namespace fxagent {

/// Reads and checks a config file: JSON with // and /* */ comments. Returns all errors together, in
/// the order of the file. Replaces `${NAME}` in strings with the environment variable; `$${NAME}`
/// stands for a plain `${NAME}`. Relative paths start at the directory of the file. Never throws.
/// `text`, if it is not nullptr, gets the text of the file: a pipe can be read only once.
tl::expected<Config, ConfigErrors> load_config(const std::string& path,
                                               std::string* text = nullptr);
/// Same for `text` in place of the content of the file, whose directory and `privacy` apply. Does
/// not access any file.
tl::expected<Config, ConfigErrors> config_of_file(const std::string& path, std::string_view text,
                                                  FilePrivacy privacy,
                                                  const ReadBounds& bounds = {});
/// Same for a text in memory. Leaves relative paths unchanged. With an `environment` other than
/// that of the process, the result depends only on the arguments.
tl::expected<Config, ConfigErrors> parse_config(
    std::string_view text, const Environment& environment = process_environment,
    FilePrivacy privacy = FilePrivacy::shared, const ReadBounds& bounds = {});

}  // namespace fxagent
