// Exit statuses of the subcommands. Prints a refusal.
#pragma once

#include <string>
#include <string_view>

namespace fxagent {

inline constexpr int kDone = 0;
/// The subcommand ran, and its answer is bad: a device is silent, a record is missing, a file could
/// not be written. Each subcommand's --help describes it.
inline constexpr int kFailed = 1;
/// The command line, the config or a file that it names is wrong.
inline constexpr int kWrong = 2;
/// check --online, doctor, scan: another process uses a link, which was not examined.
inline constexpr int kHeld = 3;
/// check --online, doctor: everything answers, and something does not match the config.
inline constexpr int kDiffers = 4;

/// Prints `why` on stderr, each of its lines as "PREFIX: line", or unchanged if `prefix` is empty.
/// Returns `status`.
int refused(std::string_view prefix, const std::string& why, int status = kWrong);

}  // namespace fxagent
