#include "agent/handover/frame_trace.h"

namespace fxagent {

void FrameTrace::add(WireFrame::Way way, ByteView bytes) {
  if (bytes.empty()) return;
  if (frames_.size() >= kMostFrames || bytes_ + bytes.size() > kMostBytes) {
    ++omitted_;
    return;
  }
  bytes_ += bytes.size();
  frames_.push_back({way, Bytes(bytes.begin(), bytes.end())});
}

}  // namespace fxagent
