// Read permissions of a config file. Code that keeps the text of the file keeps its FilePrivacy
// too.
#pragma once

#include <string>

#include "agent/config/config.h"

namespace fxagent {

/// Returns the current state of the file. A missing file counts as shared.
FilePrivacy privacy_of(const std::string& path);

}  // namespace fxagent
