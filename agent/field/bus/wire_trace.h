// Takes the frames of one link as they pass. A trace logs time, direction, bytes and meaning for an
// engineer with a serial problem; the log thread explains the frames, so that it delays no poll.
// The flight recorder's ring keeps the bytes alone. Field thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "agent/field/bus/exchange.h"
#include "agent/recorder/frame_ring.h"
#include "agent/steady_time.h"
#include "protocol/codec.h"
#include "protocol/value/bytes.h"

namespace fxagent {

struct Station;

class WireTrace final {
 public:
  /// Controls whether the frames are also logged.
  enum class Log : std::uint8_t { yes, no };

  /// `link`: its name in the config. `ring`: the flight recorder's; nullptr if it is off.
  explicit WireTrace(std::string link, Log log = Log::yes,
                     std::shared_ptr<FrameRing> ring = nullptr)
      : link_(std::move(link)), logs_(log == Log::yes), ring_(std::move(ring)) {}

  bool logs() const { return logs_; }

  /// Sets the device of the following frames; the log explains them with its codec.
  void speak_to(const Station& station);

  /// Takes the bytes that left the agent at `at`.
  void out(ByteView bytes, SteadyTime at) const { take(RecordedFrame::Way::out, bytes, at); }
  /// Takes the end of the wait for an answer, at `now`. `bytes`: all that was received, including
  /// the answer if there was one. `deadline` is that of the answer.
  void ended(const Exchange& exchange, ByteView bytes, SteadyTime now, SteadyTime deadline) const;
  /// Takes bytes that came when no answer was due, or around one.
  void unasked(ByteView bytes, SteadyTime at) const {
    take(RecordedFrame::Way::unasked, bytes, at);
  }

 private:
  void take(RecordedFrame::Way way, ByteView bytes, SteadyTime at,
            std::chrono::nanoseconds after = {}, std::string note = {}) const;
  void log(RecordedFrame::Way way, ByteView bytes, std::chrono::nanoseconds after,
           std::string note) const;

  const std::string link_;
  const bool logs_;
  /// Owned by the link and by the recorder while it writes a file.
  const std::shared_ptr<FrameRing> ring_;
  std::uint16_t recorded_as_ = kNoDevice;  ///< index of the device in the ring
  std::string device_;
  /// Owned by the device and by frames waiting to be explained: the log thread may hold the last
  /// reference.
  std::shared_ptr<const Codec> codec_;
};

}  // namespace fxagent
