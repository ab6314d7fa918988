#include "tests/support/clock_by_hand.h"

#include <asio/steady_timer.hpp>
#include <atomic>

namespace {

// One hour after the epoch, so that times slightly before the start are valid too.
std::atomic<std::chrono::nanoseconds> g_now{std::chrono::hours(1)};
constexpr std::chrono::seconds kCalendarBegins{1'790'000'000};
std::atomic<std::chrono::nanoseconds> g_calendar{kCalendarBegins};

}  // namespace

// Definitions in a program take precedence over those of the shared library.
std::chrono::steady_clock::time_point std::chrono::steady_clock::now() noexcept {
  return time_point(g_now.load(std::memory_order_relaxed));
}

std::chrono::system_clock::time_point std::chrono::system_clock::now() noexcept {
  return time_point(std::chrono::duration_cast<duration>(g_calendar.load()));
}

namespace fxagent::test {

void advance_clock(std::chrono::nanoseconds by) {
  g_now = g_now.load() + by;
  g_calendar = g_calendar.load() + by;
}

void restart_calendar() { g_calendar = kCalendarBegins; }

void poll_with_timers(asio::io_context& io) {
  // asio checks its timers when the kernel reports that the earliest is due, and the kernel does
  // not use this clock. A timer that is due at once forces the check.
  asio::steady_timer due(io, std::chrono::steady_clock::time_point::min());
  due.async_wait([](const asio::error_code&) {});
  io.restart();
  io.poll();
}

}  // namespace fxagent::test
