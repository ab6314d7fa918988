// A recording with every frame explained by the codec of its device: as text, as JSON, and as a
// capture for Wireshark.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "agent/recorder/recording.h"
#include "protocol/codec.h"
#include "protocol/value/bytes.h"

namespace fxagent {

/// The JSON of one explained frame, for `decode` and `replay`.
nlohmann::ordered_json explanation_json(const Explanation& frame);

/// A line for each frame, after those of the head.
std::string replay_text(const Replay& replay);
/// An object in a line for the head, then one for each frame.
std::string replay_json(const Replay& replay);
/// A pcapng file of link type USER0 (147). Each packet has link, device, explanation and bytes, as
/// config/wireshark/fxagent.lua takes them apart.
Bytes replay_pcapng(const Replay& replay);

}  // namespace fxagent
