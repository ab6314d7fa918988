// The newest frames of a link as the page shows them: /api/frames. Any thread.
#pragma once

#include <cstdint>
#include <string>

#include "agent/recorder/frame_ring.h"

namespace fxagent {

/// Most frames in one answer: the newest.
inline constexpr std::size_t kMostFrames = 200;

/// Returns the frames numbered `since` or higher as JSON, each explained field by field.
std::string page_frames(const FrameRing& ring, std::uint64_t since);

}  // namespace fxagent
