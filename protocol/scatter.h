// Writes and forces put together for one frame (BT, WT, random write).
#pragma once

#include <optional>
#include <vector>

#include "protocol/codec.h"

namespace fxagent {

/// A force as the write of its one bit, by the same way.
Write write_of(const Force& force);

/// All of `requests` as the parts of one Scatter, in their order. nullopt: there are fewer than
/// two, or one is neither a write nor a force. Whether a frame carries it is for the codec to say.
std::optional<Scatter> scatter_of(const std::vector<Request>& requests);

}  // namespace fxagent
