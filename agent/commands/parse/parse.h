// Parses commands as they come on a topic. Pure, any thread.
#pragma once

#include <chrono>
#include <string_view>

#include "agent/handover/command_message.h"

namespace fxagent {

/// Parses a command; never throws. `refusal` is the first fault of its form, in the contract's
/// order of checks. Everything that could be read anyway is filled in, above all the id. The caller
/// sets device, retained, times and MQTT 5 properties.
Command parse_command(std::string_view payload);

/// A command for a link: `yield` or `resume`.
struct LinkCommand {
  Command command{};              ///< its id may be empty: the id is optional
  std::chrono::minutes time{15};  ///< how long the port is yielded; 0: resume
};
/// Longest yield: a shift and a half.
inline constexpr std::chrono::minutes kLongestYield{720};
/// Parses a command for a link as parse_command().
LinkCommand parse_link_command(std::string_view payload);

}  // namespace fxagent
