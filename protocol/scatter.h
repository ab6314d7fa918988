// Combines writes and forces into one frame (BT, WT, random write).
#pragma once

#include <optional>
#include <vector>

#include "protocol/codec.h"

namespace fxagent {

/// Returns the force as a write of its single bit, by the same way.
Write write_of(const Force& force);

/// Returns all of `requests` as the parts of one Scatter, in the same order. nullopt if there are
/// fewer than two, or if one is neither a write nor a force. Does not check whether a frame can
/// carry it; the codec does.
std::optional<Scatter> scatter_of(const std::vector<Request>& requests);

}  // namespace fxagent
