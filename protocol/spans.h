// Runs of device memory put together.
#pragma once

#include <vector>

#include "protocol/point.h"

namespace fxagent {

/// The bits of all `spans` in as few spans as there can be, by space and first bit: what overlaps
/// or touches is one.
std::vector<Span> merged(std::vector<Span> spans);

}  // namespace fxagent
