#include "agent/http/page_frames.h"

#include <utility>

#include "agent/recorder/replay.h"
#include "agent/text/json_writer.h"

namespace fxagent {

std::string page_frames(const FrameRing& ring, std::uint64_t since) {
  RecordedFrames newest = ring.frames(since, kMostFrames);
  Recording recording;
  recording.devices = std::move(newest.devices);
  recording.frames = std::move(newest.frames);
  const Replay replay(std::move(recording));
  json::Writer out;
  out.begin_object().key("next").integer(newest.next).key("frames").begin_array();
  for (const RecordedFrame& frame : replay.recording().frames) {
    const auto explanation = replay.explain(frame);
    out.begin_object().key("at_us").integer(frame.at_us).key("way").string(to_string(frame.way));
    out.key("device").string(replay.device_of(frame)).key("after_ms").milliseconds(frame.after);
    out.key("hex").string(to_hex(frame.bytes)).key("says").string(meaning_of(frame, explanation));
    out.key("fields").begin_array();
    if (explanation)
      for (const auto& [name, value] : explanation->fields)
        out.begin_array().string(name).string(value).end_array();
    out.end_array().end_object();
  }
  out.end_array().end_object();
  return out.take();
}

}  // namespace fxagent
