// Who can read a config file, apart from its text: whoever keeps the text keeps this beside it.
#pragma once

#include <string>

#include "agent/config/config.h"

namespace fxagent {

/// As the file is at this moment. One that is not there is shared.
FilePrivacy privacy_of(const std::string& path);

}  // namespace fxagent
