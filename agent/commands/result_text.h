// Writes the result of a command as published and stored. Pure functions, any thread.
#pragma once

#include <chrono>
#include <cstddef>
#include <string>

#include "agent/handover/command_message.h"

namespace fxagent {

/// Largest result. Above this the details of targets are left out, then the values, then the
/// targets.
inline constexpr std::size_t kMaxResultBytes = 65536;
/// Returns the result of a command, docs/interface.md section 5; total_ms is null if not known.
std::string result_text(const CommandResult& result);
/// Returns a duration as it stands in a result.
std::string total_text(std::chrono::nanoseconds total);
/// Fills in the total_ms of a result_text(): from the command's arrival to the hand-over. A text
/// that has one stays as it is.
std::string with_total(std::string text, std::chrono::nanoseconds total);

/// Restores a result from its result_text(): `recorded` is the text; status and plc are read from
/// it. If the text is not a JSON object any more, the outcome is unknown and `recorded` empty.
CommandResult recorded_result(std::string text);

}  // namespace fxagent
