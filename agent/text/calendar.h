// Conversion between UTC times and human-readable text. Any thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace fxagent {

/// Formats a time as "2026-11-21T08:30:15.250Z". Times before the year 0 or after 32767 become
/// "-62200000000000 ms".
std::string utc_text(std::int64_t utc_ms);

/// Parses "2026-11-21", "2026-11-21T08:30" or "2026-11-21T08:30:15", each with or without a
/// trailing Z, to milliseconds UTC. Returns nullopt for any other text.
std::optional<std::int64_t> utc_ms_from(std::string_view text);

}  // namespace fxagent
