#include "agent/config/wiring.h"

#include <variant>

namespace fxagent {
namespace {

template <class Network>
std::string endpoint(const Network& network) {
  return network.host + ":" + std::to_string(network.port);
}

}  // namespace

Wiring wiring_of(const LinkConfig& link, const DeviceConfig& device) {
  Wiring wiring;
  wiring.echo = device.echo;
  if (const auto* serial = std::get_if<SerialSettings>(&link.channel)) {
    wiring.place = serial->path;
    wiring.line = {serial->baud, serial->data_bits, serial->parity, serial->stop_bits};
  } else if (const auto* tcp = std::get_if<TcpSettings>(&link.channel)) {
    wiring.channel = Wiring::Channel::tcp;
    wiring.place = endpoint(*tcp);
  } else {
    wiring.channel = Wiring::Channel::udp;
    wiring.place = endpoint(std::get<UdpSettings>(link.channel));
  }
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
