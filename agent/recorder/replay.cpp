#include "agent/recorder/replay.h"

#include <utility>

#include "agent/text/text.h"
#include "protocol/explanation.h"

namespace fxagent {

Replay::Replay(Recording recording) : recording_(std::move(recording)) {
  for (const RecordedDevice& device : recording_.devices) codecs_.push_back(codec_of(device));
}

std::optional<Explanation> Replay::explain(const RecordedFrame& frame) const {
  if (frame.bytes.empty() || frame.device >= codecs_.size() || !codecs_[frame.device])
    return std::nullopt;
  return codecs_[frame.device]->explain(
      frame.bytes, frame.way == RecordedFrame::Way::out ? Direction::request : Direction::reply);
}

const std::string& Replay::device_of(const RecordedFrame& frame) const {
  static const std::string none;
  return frame.device < recording_.devices.size() ? recording_.devices[frame.device].name : none;
}

std::string meaning_of(const RecordedFrame& frame, const std::optional<Explanation>& explanation) {
  std::string meaning = frame.note;
  if (meaning.empty() && frame.way == RecordedFrame::Way::unasked) meaning = "unexpected bytes";
  if (explanation) meaning += (meaning.empty() ? "" : "; ") + summary(*explanation);
  return escaped(meaning, Escape::message);
}

}  // namespace fxagent
