// TCP_NODELAY for a connection that a library has made and does not hand out.
#pragma once

#include <cstdint>

namespace fxagent {

/// Port of the peer in host order; 0 where `fd` is no connected TCP socket. Any thread.
std::uint16_t peer_port(int fd) noexcept;

/// Sets TCP_NODELAY on every socket of this process that is connected to `port` somewhere. Without
/// it the second of two small messages waits for the ACK of the first: 40 ms, where the peer delays
/// its ACKs. A socket that has it already keeps it. Any thread.
void send_at_once(std::uint16_t port) noexcept;

}  // namespace fxagent
