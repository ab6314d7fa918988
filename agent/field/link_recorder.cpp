#include "agent/field/link_recorder.h"

#include <chrono>
#include <variant>

#include "agent/steady_time.h"

namespace fxagent {
namespace {

std::string wire_text(const LinkConfig& link) {
  if (const auto* serial = std::get_if<SerialSettings>(&link.channel)) {
    constexpr std::string_view kParities = "NEO";  // as in Parity
    return "serial " + serial->path + " " + std::to_string(serial->baud) + " " +
           std::to_string(serial->data_bits) + kParities[static_cast<std::size_t>(serial->parity)] +
           std::to_string(serial->stop_bits);
  }
  if (const auto* udp = std::get_if<UdpSettings>(&link.channel))
    return "udp " + udp->host + ":" + std::to_string(udp->port);
  const auto& tcp = std::get<TcpSettings>(link.channel);
  return "tcp " + tcp.host + ":" + std::to_string(tcp.port);
}

}  // namespace

LinkRecorder::LinkRecorder(FlightRecorder* recorder, const LinkConfig& link)
    : recorder_(recorder), link_(link) {
  if (recorder_ != nullptr) ring_ = recorder_->new_ring(link.name, wire_text(link));
}

std::uint16_t LinkRecorder::number(const DeviceConfig& device) {
  if (!ring_ || device.protocol == nullptr) return kNoDevice;
  return ring_->number({device.name, std::string(device.protocol->name),
                        device.options ? *device.options : default_options(*device.protocol)});
}

void LinkRecorder::look(std::uint64_t bad_frames, bool is_up, const std::string& why_down) {
  if (!ring_) return;
  if (burst_.add(bad_frames, std::chrono::steady_clock::now()))
    recorder_->anomaly(link_.name, "a burst of bad frames");
  if (was_up_ && !is_up) recorder_->anomaly(link_.name, "link down: " + why_down);
  was_up_ = is_up;
}

void LinkRecorder::ended(const CommandResult& result, const std::string& device) {
  if (!ring_) return;
  const std::string command =
      "command " + (result.id.empty() ? "without id" : result.id) + " for " + device;
  if (result.status == CommandStatus::unknown_outcome)
    recorder_->anomaly(link_.name, "UNKNOWN_OUTCOME: " + command);
  if (result.bound && result.queue + result.wire > *result.bound)
    recorder_->anomaly(link_.name, "over its bound: " + command + " took " +
                                       whole_ms(result.queue + result.wire) + " of " +
                                       whole_ms(*result.bound) + " ms");
}

}  // namespace fxagent
