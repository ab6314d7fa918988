// Times as people write them, in UTC. Any thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace fxagent {

/// "2026-11-21T08:30:15.250Z"; "-62200000000000 ms" before the year 0 and after 32767.
std::string utc_text(std::int64_t utc_ms);

/// Milliseconds UTC of "2026-11-21", "2026-11-21T08:30" or "2026-11-21T08:30:15", each with a Z
/// behind it or without. Nothing: it is none of these.
std::optional<std::int64_t> utc_ms_from(std::string_view text);

}  // namespace fxagent
