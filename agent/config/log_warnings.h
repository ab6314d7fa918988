// Logs the warnings of a config before it comes into force.
#pragma once

#include "agent/config/machine.h"

namespace fxagent {

/// Logs the warnings of `config` and clears them. Also logs the files of exposed_secrets().
void log_warnings(Config& config);

}  // namespace fxagent
