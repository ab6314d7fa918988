// Reads commands as they come on a topic. Pure, any thread.
#pragma once

#include <string_view>

#include "agent/messages.h"

namespace fxagent {

/// Reads a command; never throws. Whatever is wrong with its form stands in `refusal`: the first
/// fault in the contract's order of checks. What could be read in spite of it is filled in, the id
/// above all. device, retained, times and MQTT 5 properties are the caller's to set.
Command parse_command(std::string_view payload);

}  // namespace fxagent
