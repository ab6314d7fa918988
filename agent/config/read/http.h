// Reads the sections `http` and `metrics` of the config file: the address of the HTTP server.
#pragma once

#include <optional>

#include "agent/config/model.h"
#include "agent/config/read/reader.h"

namespace fxagent {

/// Reads both sections of the file at `top`, of which it may have one. Warns if other machines can
/// reach the address. Returns nullopt if there is none, and after an error, which is reported to
/// `reader`.
std::optional<HttpConfig> read_http(ConfigReader& reader, const ConfigNode& top);

}  // namespace fxagent
