// Connects one link to the flight recorder: its ring of frames, and the anomalies that make the
// recorder write a file. Without a recorder it does nothing. Field thread.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "agent/config/model.h"
#include "agent/handover/command_message.h"
#include "agent/recorder/flight_recorder.h"

namespace fxagent {

class LinkRecorder final {
 public:
  /// `recorder`, if not null, and `link` must outlive it.
  LinkRecorder(FlightRecorder* recorder, const LinkConfig& link);

  /// Returns the link's ring; nullptr without a recorder.
  const std::shared_ptr<FrameRing>& ring() const { return ring_; }
  /// Returns the index of the device for frames.
  std::uint16_t number(const DeviceConfig& device);

  /// Compares the link with the previous call: a link that went down and a burst of bad frames are
  /// anomalies.
  void look(std::uint64_t bad_frames, bool is_up, const std::string& why_down);
  /// Takes the result of a command: UNKNOWN_OUTCOME and a result after its bound are anomalies.
  void ended(const CommandResult& result, const std::string& device);

 private:
  FlightRecorder* const recorder_;
  const LinkConfig& link_;
  std::shared_ptr<FrameRing> ring_;  ///< owned with the link's WireTrace
  FrameBurst burst_;
  bool was_up_ = false;
};

}  // namespace fxagent
