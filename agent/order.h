// A command that comes from the page or from another profile instead of the agent's own session.
#pragma once

#include <string>

#include "agent/command_message.h"

namespace fxagent {

struct Order : MessageProperties {
  std::string device;   ///< its name
  std::string payload;  ///< as on a command topic
};

}  // namespace fxagent
