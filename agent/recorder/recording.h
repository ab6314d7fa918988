// The text of a recording: what the flight recorder writes and `replay` reads. One line a frame, so
// that people and other programs can read it; docs/operate/recorder.md describes it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "agent/recorder/frame_ring.h"
#include "protocol/codec.h"

namespace fxagent {

/// Place of the number that a protocol gives to each request and its answer, in bytes.
struct NumberPlace {
  std::size_t offset = 0;
  std::size_t size = 0;  ///< 0: frames carry no number
  friend bool operator==(const NumberPlace&, const NumberPlace&) = default;
};
/// Finds it by comparing a request with two numbers.
NumberPlace number_place(const Codec& codec);

struct RecordingHead {
  std::string agent{};    ///< its id
  std::string version{};  ///< of the program
  std::string link{};     ///< its name
  std::string wire{};     ///< "serial /dev/ttyUSB0 9600 7E1", "tcp 10.0.0.7:5007"
  std::string reason{};   ///< why it was written
  std::int64_t written_us = 0;
};

struct Recording {
  RecordingHead head{};
  std::vector<RecordedDevice> devices{};
  std::vector<RecordedFrame> frames{};
};

/// Returns "out", "in", "failed" or "unasked".
std::string_view to_string(RecordedFrame::Way way);

/// Formats µs UTC as "2026-11-21T08:30:15.250123Z".
std::string utc_us_text(std::int64_t utc_us);

/// Returns the text. Control characters in texts become `?`.
std::string recording_text(const RecordingHead& head, const RecordedFrames& frames);

/// Largest file that `parse_recording` accepts, in bytes.
inline constexpr std::size_t kMostRecordingBytes = std::size_t{64} << 20;

/// Reads such a text. The error names line, cause and cure.
tl::expected<Recording, std::string> parse_recording(std::string_view text);

/// Explains the frames of a recording with the codecs of its devices.
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
