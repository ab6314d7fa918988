// Writes the result of a command as it is published and kept. Pure functions, any thread.
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <string>

#include "agent/messages.h"

namespace fxagent {

/// No result is larger: the details of its targets are left out first, then the values.
inline constexpr std::size_t kMaxResultBytes = 65536;
/// The result of a command, contract section 5. `total` is receipt until now; null where it is not
/// known any more (the first result inside a DUPLICATE).
std::string result_text(const CommandResult& result, std::optional<std::chrono::nanoseconds> total);

/// What result_text() made in an earlier run: `recorded` is the text, status and plc are read from
/// it. Where the text is no JSON object any more, the outcome is unknown and `recorded` empty.
CommandResult recorded_result(std::string text);

}  // namespace fxagent
