// Parts of a Scatter.
#pragma once

#include "protocol/codec.h"

namespace fxagent {

/// Returns the force as a write of its single bit, by the same way.
Write write_of(const Force& force);

}  // namespace fxagent
