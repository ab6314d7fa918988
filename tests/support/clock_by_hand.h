// Manually set clocks for a test program. A program linked with clock_by_hand.cpp has no other
// clocks, including in its libraries. Seconds at a plant take no time here, and every run is the
// same.
#pragma once

#include <asio/io_context.hpp>
#include <chrono>

namespace fxagent::test {

/// Advances std::chrono::steady_clock and system_clock by `by`.
void advance_clock(std::chrono::nanoseconds by);
/// Sets system_clock back to its start, 2026-09-21 14:13:20 UTC.
void restart_calendar();

/// Expires the timers of `io` that are due and runs all ready handlers.
void poll_with_timers(asio::io_context& io);

}  // namespace fxagent::test
