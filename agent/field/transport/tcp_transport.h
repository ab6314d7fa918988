// A TCP stream to a transparent serial server or a device, with no-delay and keep-alive. Field
// thread only.
#pragma once

#include <asio/any_io_executor.hpp>
#include <memory>

#include "agent/config/model.h"
#include "agent/field/transport/transport.h"

namespace fxagent {

/// Returns a closed stream; open() resolves the host and connects.
std::unique_ptr<Transport> make_tcp_transport(asio::any_io_executor executor, TcpSettings settings);

}  // namespace fxagent
