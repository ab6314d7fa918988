// Lists what to check when a device does not answer, quoting the device's own settings.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "protocol/catalog.h"

namespace fxagent {

/// Connection of a device.
struct Wiring {
  enum class Channel : std::uint8_t { serial, tcp, udp };
  Channel channel = Channel::serial;
  std::string place;  ///< "/dev/ttyUSB0", "192.0.2.10:502"
  /// Settings of the serial port; nullopt on a network channel, where the agent sets none.
  std::optional<LineDefaults> line{};
  bool echo = false;  ///< the config says that the line returns what is sent
};

/// Answers received on the channel since it came into use.
enum class Answers : std::uint8_t {
  none,
  from_others,  ///< other devices answer; this one never has
  of_gateway,   ///< a gateway answers on behalf of this device
  until_now,    ///< this device has answered before
  others_now,   ///< this device has answered before; other devices on the channel answer now
};

/// Returns one human-readable line: what to check, most likely cause first. At most 1,000 bytes.
/// Quotes the device's settings from `options`, from which `codec` was made. A setting missing from
/// them is named without a value.
std::string checklist(const ProtocolInfo& protocol, const Options& options, const Codec& codec,
                      const Wiring& wiring, Answers answers);
/// Returns what to check if the device closes each connection before its first answer. Empty if the
/// protocol has no advice.
std::string_view checklist_of_closed(const ProtocolInfo& protocol, const Codec& codec);

/// "9600 baud 7E1".
std::string to_string(const LineDefaults& line);

}  // namespace fxagent
