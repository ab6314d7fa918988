// What deserves a look in a config that is about to be in force, as lines of the log.
#pragma once

#include "agent/config/config.h"

namespace fxagent {

/// Logs the warnings of `config`, which has none afterwards, and the secrets that others can read.
void log_warnings(Config& config);

}  // namespace fxagent
