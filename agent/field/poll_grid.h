// Polls of many links share their moments: one waking of the thread sends the requests of all that
// are due, and meets their answers together. Pure.
#pragma once

#include <chrono>

#include "agent/messages.h"

namespace fxagent {

/// The spacing of the moments at which groups with this interval begin: 10, 5, 2 or 1 ms, the
/// largest that is no more than a hundredth of the interval and divides it, so that later cycles
/// keep to it but while an overload stretches the interval. 0 where the interval is below 100 ms:
/// such groups begin when they like.
std::chrono::milliseconds grid_of(std::chrono::milliseconds interval);

/// The first moment of the grid of `interval` at or after `due`. Grids of all links have the same
/// origin.
SteadyTime on_grid(SteadyTime due, std::chrono::milliseconds interval);

}  // namespace fxagent
