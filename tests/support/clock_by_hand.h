// The clocks of a test program, set by hand: a program that is linked with clock_by_hand.cpp has no
// others, its libraries included. What takes seconds at a plant takes none here, and a program does
// the same each time.
#pragma once

#include <asio/io_context.hpp>
#include <chrono>

namespace fxagent::test {

/// std::chrono::steady_clock stands `by` further on, and so does system_clock.
void advance_clock(std::chrono::nanoseconds by);
/// system_clock stands at 2026-09-21 14:13:20 UTC again, where it began.
void restart_calendar();

/// Lets the timers of `io` that are due by now end, and handles all that is ready.
void poll_with_timers(asio::io_context& io);

}  // namespace fxagent::test
