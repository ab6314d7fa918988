// The frames of a command, for the audit and the page. Plain data.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "protocol/value/bytes.h"

namespace fxagent {

/// Bytes that crossed a wire together.
struct WireFrame {
  enum class Way : std::uint8_t { out, in };
  Way way = Way::out;
  Bytes bytes;
};

/// Frames that a command sent and received, for the audit. Bounded: keeps the beginning of a long
/// exchange and counts the rest.
class FrameTrace final {
 public:
  static constexpr std::size_t kMostFrames = 64;
  static constexpr std::size_t kMostBytes = 4096;

  void add(WireFrame::Way way, ByteView bytes);
  const std::vector<WireFrame>& frames() const { return frames_; }
  std::uint64_t omitted() const { return omitted_; }  ///< frames dropped for lack of room

 private:
  std::vector<WireFrame> frames_;
  std::size_t bytes_ = 0;
  std::uint64_t omitted_ = 0;
};

}  // namespace fxagent
