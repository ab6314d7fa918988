// Plays a recording of fxagent's flight recorder: answers each request as the device did. Reads the
// file on its own, as docs/operate/recorder.md describes it.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "tests/sim/personality.h"

namespace fxsim {

/// A request and what came back, in order of the recording.
struct RecordedAnswer {
  Bytes bytes;  // empty: silence
  std::chrono::milliseconds after{0};
};
struct RecordedRequest {
  Bytes bytes;
  // Place of the number that requests and their answers carry; size 0: none.
  std::size_t number_at = 0;
  std::size_t number_size = 0;
  std::vector<RecordedAnswer> answers;

  /// True if `frame` begins this request, whatever its number is.
  bool begins_with(ByteView frame) const;
};

struct Recording {
  std::string link;
  std::string wire;  // "serial ...", "tcp HOST:PORT" or "udp HOST:PORT"
  std::vector<RecordedRequest> requests;
};

/// Parses the text of a recording. Throws ConfigError, which names the line.
Recording parse_recording(std::string_view text);
/// The same for a file.
Recording read_recording(const std::string& path);

/// All devices of a recorded line. Each request has its answers in the recorded order; after the
/// last one the first follows. A request that was not recorded gets no answer.
std::unique_ptr<Personality> make_recorded_device(std::shared_ptr<const Recording> recording);

}  // namespace fxsim
