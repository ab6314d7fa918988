// A TCP stream to a transparent serial server or a device. No delay, keep-alive. Field thread only.
#pragma once

#include <asio/any_io_executor.hpp>
#include <memory>

#include "agent/config/config.h"
#include "agent/field/transport.h"

namespace fxagent {

/// Of the files that the process may have open so many are not for links: the store and its
/// journal, the broker's socket and the next one's, epoll, stderr, serial ports, and what resolving
/// a host name opens for a moment.
inline constexpr int kFilesNotForLinks = 40;

/// asio looks names up on a thread of its own, which it starts with the first one: it is started
/// here, so that a system that has none says so at the start. Throws std::system_error then.
void start_looking_up(const asio::any_io_executor& executor);

/// A closed stream; open() resolves and connects.
std::unique_ptr<Transport> make_tcp_transport(asio::any_io_executor executor, TcpSettings settings);

}  // namespace fxagent
