// Feeds arbitrary text to the reader of recordings. Every accepted recording must survive being
// written and read again, and each of its frames must have an explanation that ends.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "agent/cli/recording/replay_report.h"
#include "agent/recorder/recording.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace fxagent;
  auto recording = parse_recording({reinterpret_cast<const char*>(data), size});
  if (!recording) {
    if (recording.error().empty()) std::abort();
    return 0;
  }
  RecordedFrames frames;
  frames.devices = recording->devices;
  frames.frames = recording->frames;
  const auto again = parse_recording(recording_text(recording->head, frames));
  if (!again || again->frames.size() != frames.frames.size() || again->devices != frames.devices)
    std::abort();
  const Replay replay(std::move(*recording));
  replay_text(replay);
  replay_json(replay);
  replay_pcapng(replay);
  return 0;
}
