// A recording with every frame explained by the codec of its device: as text, as JSON, and as a
// capture for Wireshark.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "agent/recorder/recording.h"
#include "protocol/codec.h"

namespace fxagent {

/// A recording and the codecs of its devices.
class Replay final {
 public:
  explicit Replay(Recording recording);

  const Recording& recording() const { return recording_; }
  /// Explains the frame. nullopt without bytes or without a device.
  std::optional<Explanation> explain(const RecordedFrame& frame) const;
  /// Returns the name of the frame's device; empty if it has none.
  const std::string& device_of(const RecordedFrame& frame) const;

 private:
  Recording recording_;
  std::vector<std::shared_ptr<const Codec>> codecs_;
};

/// Returns "out", "in", "failed" or "unasked".
std::string_view to_string(RecordedFrame::Way way);
/// Returns the note and the meaning of a frame in one line.
std::string meaning_of(const Replay& replay, const RecordedFrame& frame);

/// A line for each frame, after those of the head.
std::string replay_text(const Replay& replay);
/// An object in a line for the head, then one for each frame.
std::string replay_json(const Replay& replay);
/// A pcapng file of link type USER0 (147). Each packet has link, device, explanation and bytes, as
/// config/wireshark/fxagent.lua takes them apart.
Bytes replay_pcapng(const Replay& replay);

}  // namespace fxagent
