// Explains the frames of a recording with the codecs of its devices.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
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

/// Returns the note of a frame, and its meaning if it has one, in one line. `explanation` is that
/// of Replay::explain().
std::string meaning_of(const RecordedFrame& frame, const std::optional<Explanation>& explanation);

}  // namespace fxagent
