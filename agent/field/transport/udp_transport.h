// Datagrams to and from one device, on a socket that accepts none from other senders. Field thread
// only.
#pragma once

#include <asio/any_io_executor.hpp>
#include <memory>

#include "agent/config/model.h"
#include "agent/field/transport/transport.h"

namespace fxagent {

/// Returns a closed socket; open() resolves the host and takes a port, whether or not the device is
/// there. If the name has several addresses, each open() takes the next one until one has answered.
std::unique_ptr<Transport> make_udp_transport(asio::any_io_executor executor, UdpSettings settings);

}  // namespace fxagent
