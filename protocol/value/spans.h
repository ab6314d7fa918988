// Merges runs of device memory.
#pragma once

#include <vector>

#include "protocol/value/point.h"

namespace fxagent {

/// Returns the bits of all `spans` in as few spans as possible, sorted by space and first bit.
/// Spans that overlap or touch become one.
std::vector<Span> merged(std::vector<Span> spans);

}  // namespace fxagent
