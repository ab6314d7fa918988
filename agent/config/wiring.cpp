#include "agent/config/wiring.h"

#include <variant>

namespace fxagent {

Wiring wiring_of(const LinkConfig& link, const DeviceConfig& device) {
  Wiring wiring;
  wiring.echo = device.echo;
  wiring.place = endpoint_of(link);
  if (const auto* serial = std::get_if<SerialSettings>(&link.channel))
    wiring.line = {serial->baud, serial->data_bits, serial->parity, serial->stop_bits};
  else
    wiring.channel = std::holds_alternative<TcpSettings>(link.channel) ? Wiring::Channel::tcp
                                                                       : Wiring::Channel::udp;
  return wiring;
}

std::string checklist_of(const DeviceConfig& device, const Codec& codec, const Wiring& wiring,
                         Answers answers) {
  if (device.protocol == nullptr) return {};
  static const Options kUnknown;
  return checklist(*device.protocol, device.options ? *device.options : kUnknown, codec, wiring,
                   answers);
}

}  // namespace fxagent
