#include "agent/field/transport/transport.h"

#include <variant>

namespace fxagent {

std::unique_ptr<Transport> make_transport(const asio::any_io_executor& executor,
                                          const LinkConfig& link) {
  if (const auto* serial = std::get_if<SerialSettings>(&link.channel))
    return make_serial_transport(executor, *serial);
  if (const auto* udp = std::get_if<UdpSettings>(&link.channel))
    return make_udp_transport(executor, *udp);
  return make_tcp_transport(executor, std::get<TcpSettings>(link.channel));
}

}  // namespace fxagent
