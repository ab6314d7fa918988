// Datagrams to one device and back, on a socket that takes none of anybody else. Field thread only.
#pragma once

#include <asio/any_io_executor.hpp>
#include <memory>

#include "agent/config/config.h"
#include "agent/field/transport.h"

namespace fxagent {

/// A closed socket; open() resolves and takes a port. It is open then whether or not the device is
/// there. Of a name with several addresses each open() takes the next one, until one has answered.
std::unique_ptr<Transport> make_udp_transport(asio::any_io_executor executor, UdpSettings settings);

}  // namespace fxagent
