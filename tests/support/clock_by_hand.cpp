#include "tests/support/clock_by_hand.h"

#include <asio/steady_timer.hpp>
#include <atomic>

namespace {

// An hour after its epoch: times that lie a little before the start are times too.
std::atomic<std::chrono::nanoseconds> g_now{std::chrono::hours(1)};
constexpr std::chrono::seconds kCalendarBegins{1'790'000'000};
std::atomic<std::chrono::nanoseconds> g_calendar{kCalendarBegins};

}  // namespace

// The definitions in a program go before those of the shared library.
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
  // asio looks at its timers when the kernel says that the earliest is due, and the kernel does not
  // know this clock. One that is due at once makes it look.
  asio::steady_timer due(io, std::chrono::steady_clock::time_point::min());
  due.async_wait([](const asio::error_code&) {});
  io.restart();
  io.poll();
}

}  // namespace fxagent::test
