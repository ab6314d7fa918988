// Generates fxagent.json(5) from the table of config keys.
#pragma once

#include <string>

namespace fxagent {

/// Returns the man page of the config file in roff: each section with its keys, then the keys of
/// each protocol.
std::string config_page(const std::string& version);

}  // namespace fxagent
