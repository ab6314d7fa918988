// Parses commands as they come on a topic. Pure, any thread.
#pragma once

#include <string_view>

#include "agent/command_message.h"

namespace fxagent {

/// Parses a command; never throws. `refusal` is the first fault of its form, in the contract's
/// order of checks. Everything that could be read anyway is filled in, above all the id. The caller
/// sets device, retained, times and MQTT 5 properties.
Command parse_command(std::string_view payload);

}  // namespace fxagent
