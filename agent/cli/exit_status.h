// The exit statuses that all commands share, and how a command refuses what was asked.
#pragma once

#include <string>
#include <string_view>

namespace fxagent {

inline constexpr int kDone = 0;
/// The question, the config or the command line is wrong, and nothing was done.
inline constexpr int kWrong = 2;

/// Prints `why` on stderr, each of its lines as "COMMAND: line", or as it is if `command` is empty.
/// Returns `status`.
int refused(std::string_view command, const std::string& why, int status = kWrong);

}  // namespace fxagent
