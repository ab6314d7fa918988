// Aligns the polls of many links: one wake-up of the thread sends all requests that are due, and
// receives their answers together. Pure.
#pragma once

#include <chrono>

#include "agent/steady_time.h"

namespace fxagent {

/// Returns the grid for groups with this interval: 10, 5, 2 or 1 ms. It is the largest that divides
/// the interval and is at most 1/100 of it, so that later cycles stay on the grid unless an
/// overload stretches the interval. Returns 0 for an interval below 100 ms: such groups begin at
/// any time.
std::chrono::milliseconds grid_of(std::chrono::milliseconds interval);

/// Returns the first grid time of `interval` at or after `due`. The grids of all links have the
/// same origin.
SteadyTime on_grid(SteadyTime due, std::chrono::milliseconds interval);

}  // namespace fxagent
