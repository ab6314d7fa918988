// Writes the result of a command as it is published and kept. Pure functions, any thread.
#pragma once

#include <chrono>
#include <cstddef>
#include <string>

#include "agent/messages.h"

namespace fxagent {

/// No result is larger: the details of its targets are left out first, then the values.
inline constexpr std::size_t kMaxResultBytes = 65536;
/// The result of a command, agent/CONTRACT.md section 5; total_ms is null where it is not known.
std::string result_text(const CommandResult& result);
/// A duration as it stands in a result.
std::string total_text(std::chrono::nanoseconds total);
/// The text of result_text() with its total_ms: from the command's arrival until now. One that has
/// it stays as it is.
std::string with_total(std::string text, std::chrono::nanoseconds total);

/// What result_text() made in an earlier run: `recorded` is the text, status and plc are read from
/// it. Where the text is no JSON object any more, the outcome is unknown and `recorded` empty.
CommandResult recorded_result(std::string text);

}  // namespace fxagent
