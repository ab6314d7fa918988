// Points in time: by the steady clock, and by the calendar. Names that end in `_ms` hold
// milliseconds UTC since 1970; durations are std::chrono.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

namespace fxagent {

using SteadyTime = std::chrono::steady_clock::time_point;

/// Converts a system clock reading to milliseconds UTC since 1970.
inline std::int64_t utc_ms(std::chrono::system_clock::time_point t) {
  return std::chrono::duration_cast<std::chrono::milliseconds>(t.time_since_epoch()).count();
}

/// Returns the current time in milliseconds UTC since 1970.
inline std::int64_t utc_now_ms() { return utc_ms(std::chrono::system_clock::now()); }

/// Converts a system clock reading to microseconds UTC since 1970.
inline std::int64_t utc_us(std::chrono::system_clock::time_point t) {
  return std::chrono::duration_cast<std::chrono::microseconds>(t.time_since_epoch()).count();
}

/// Returns the duration in whole milliseconds, rounded.
inline std::string whole_ms(std::chrono::nanoseconds duration) {
  return std::to_string(std::chrono::round<std::chrono::milliseconds>(duration).count());
}

}  // namespace fxagent
