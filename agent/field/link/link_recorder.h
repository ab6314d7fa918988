// Connects one link to the flight recorder: its ring of frames, and the anomalies that make the
// recorder write a file. Without a recorder it does nothing. Field thread.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "agent/config/model.h"
#include "agent/handover/command_message.h"
#include "agent/recorder/flight_recorder.h"
#include "agent/steady_time.h"

namespace fxagent {

/// Detects a burst of bad frames: a few are noise, many in a short time are a fault. Pure.
class FrameBurst final {
 public:
  static constexpr std::uint64_t kFrames = 5;
  static constexpr std::chrono::seconds kWithin{60};

  /// Takes the number of bad frames since the start. Returns true once for each kFrames of them
  /// that came within kWithin.
  bool add(std::uint64_t total, SteadyTime now) {
    if (total <= seen_) return false;
    if (counted_ == 0 || now - since_ > kWithin) {
      counted_ = 0;
      since_ = now;
    }
    counted_ += total - seen_;
    seen_ = total;
    if (counted_ < kFrames) return false;
    counted_ = 0;
    return true;
  }

 private:
  std::uint64_t seen_ = 0;
  std::uint64_t counted_ = 0;
  SteadyTime since_{};
};

class LinkRecorder final {
 public:
  /// `recorder`, if not null, and `link` must outlive it. `bytes` is the size of the ring.
  LinkRecorder(FlightRecorder* recorder, const LinkConfig& link, std::size_t bytes);

  /// Returns the link's ring; nullptr without a recorder.
  const std::shared_ptr<FrameRing>& ring() const { return ring_; }
  /// Returns the index of the device for frames.
  std::uint16_t number(const DeviceConfig& device);

  /// Compares with the previous call: a lost link and a burst of bad frames are anomalies.
  void check_link(std::uint64_t bad_frames, bool is_up, const std::string& why_down);
  /// Takes the result of a command: UNKNOWN_OUTCOME and a result after `bound` are anomalies.
  /// nullopt: no bound applies.
  void ended(const CommandResult& result, const std::string& device,
             std::optional<std::chrono::nanoseconds> bound);

 private:
  FlightRecorder* const recorder_;
  const LinkConfig& link_;
  std::shared_ptr<FrameRing> ring_;  ///< owned with the link's WireTrace
  FrameBurst burst_;
  bool was_up_ = false;
};

}  // namespace fxagent
