#include "agent/field/link/link_recorder.h"

#include <chrono>

namespace fxagent {

LinkRecorder::LinkRecorder(FlightRecorder* recorder, const LinkConfig& link, std::size_t bytes)
    : recorder_(recorder), link_(link) {
  if (recorder_ != nullptr) ring_ = recorder_->new_ring(link.name, channel_text(link), bytes);
}

std::uint16_t LinkRecorder::number(const DeviceConfig& device) {
  if (!ring_ || device.protocol == nullptr) return kNoDevice;
  return ring_->number({device.name, std::string(device.protocol->name),
                        device.options ? *device.options : default_options(*device.protocol)});
}

void LinkRecorder::check_link(std::uint64_t bad_frames, bool is_up, const std::string& why_down) {
  if (!ring_) return;
  if (burst_.add(bad_frames, std::chrono::steady_clock::now()))
    recorder_->anomaly(link_.name, "a burst of bad frames");
  if (was_up_ && !is_up) recorder_->anomaly(link_.name, "link down: " + why_down);
  was_up_ = is_up;
}

void LinkRecorder::ended(const CommandResult& result, const std::string& device,
                         std::optional<std::chrono::nanoseconds> bound) {
  if (!ring_) return;
  const std::string command =
      "command " + (result.id.empty() ? "without id" : result.id) + " for " + device;
  if (result.status == CommandStatus::unknown_outcome)
    recorder_->anomaly(link_.name, "UNKNOWN_OUTCOME: " + command);
  if (bound && result.queue + result.wire > *bound)
    recorder_->anomaly(link_.name, "over its bound: " + command + " took " +
                                       whole_ms(result.queue + result.wire) + " of " +
                                       whole_ms(*bound) + " ms");
}

}  // namespace fxagent
