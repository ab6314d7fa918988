// Shows the frames of one link in the log while they pass: time, direction, bytes, and what they
// mean. For an engineer with a serial problem. A link that is not traced has none. What a frame
// means is worked out on the log's thread, so that a trace moves no poll. Field thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "agent/messages.h"
#include "protocol/bytes.h"
#include "protocol/codec.h"

namespace fxagent {

class WireTrace final {
 public:
  /// `link`: its name in the config.
  explicit WireTrace(std::string link) : link_(std::move(link)) {}

  /// What follows is spoken to this device, whose codec explains it.
  void speak_to(std::string_view device, std::shared_ptr<const Codec> codec);

  /// Left the agent, as far as it was sent.
  void out(ByteView bytes) const;
  /// The answer came so long after the first byte of its question left.
  void answer(ByteView bytes, std::chrono::nanoseconds after) const;
  /// No answer: `bytes` came within that time, or nothing. `why` says what is wrong; empty: there
  /// is no end of it.
  void no_answer(ByteView bytes, std::chrono::nanoseconds within, std::string why) const;
  /// Bytes that came when no answer was due, or beside one.
  void unasked(ByteView bytes) const;

 private:
  /// Whether it is told what the bytes mean, behind `note`.
  enum class Explained : std::uint8_t { yes, no };
  void show(WireFrame::Way way, ByteView bytes, std::chrono::nanoseconds after, std::string note,
            Explained explained) const;

  const std::string link_;
  std::string device_;
  /// The device's, and of what waits to be explained: the log's thread may be the last to have it.
  std::shared_ptr<const Codec> codec_;
};

}  // namespace fxagent
