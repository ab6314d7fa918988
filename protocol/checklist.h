// Lists what to look at when a device does not answer, with the settings of the device in the text.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "protocol/catalog.h"

namespace fxagent {

/// How a device is connected.
struct Wiring {
  enum class Channel : std::uint8_t { serial, tcp, udp };
  Channel channel = Channel::serial;
  std::string place;  ///< "/dev/ttyUSB0", "192.0.2.10:502"
  /// Settings of the serial port; nullopt: a network channel, where the agent sets none.
  std::optional<LineDefaults> line{};
  bool echo = false;  ///< the line is configured to return what is sent
};

/// Answers on the channel since it is in use.
enum class Answers : std::uint8_t {
  none,
  from_others,  ///< other devices answer, this one never has
  of_gateway,   ///< a gateway answers in place of this device
  until_now,    ///< this device has answered before
};

/// Returns one line for a person: what to check, most likely cause first. At most 1,000 bytes.
/// Quotes the device's own settings: `options` are those that `codec` was made of; settings that it
/// lacks are named without a value.
std::string checklist(const ProtocolInfo& protocol, const Options& options, const Codec& codec,
                      const Wiring& wiring, Answers answers);
/// Returns what to check when the device closes each connection before its first answer; empty:
/// the protocol has no advice.
std::string_view checklist_of_closed(const ProtocolInfo& protocol, const Codec& codec);

/// "9600 baud 7E1".
std::string to_string(const LineDefaults& line);

}  // namespace fxagent
