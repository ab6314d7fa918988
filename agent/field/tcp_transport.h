// A TCP stream to a transparent serial server or a device. No delay, keep-alive. Field thread only.
#pragma once

#include <asio/any_io_executor.hpp>
#include <memory>

#include "agent/config.h"
#include "agent/field/transport.h"

namespace fxagent {

/// Of the files that the process may have open so many are not for links: the store and its
/// journal, the broker's socket and the next one's, epoll, stderr, serial ports, and what resolving
/// a host name opens for a moment.
inline constexpr int kFilesNotForLinks = 40;

/// A closed stream; open() resolves and connects.
std::unique_ptr<Transport> make_tcp_transport(asio::any_io_executor executor, TcpSettings settings);

}  // namespace fxagent
