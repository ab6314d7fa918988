// fxagent.json(5), made from the table of config keys.
#pragma once

#include <string>

namespace fxagent {

/// The man page of the config file in roff: each section with its keys, then those of each
/// protocol.
std::string config_page(const std::string& version);

}  // namespace fxagent
