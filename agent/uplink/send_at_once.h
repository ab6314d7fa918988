// TCP_NODELAY for a connection that a library has made and does not hand out.
#pragma once

namespace fxagent {

/// Sets TCP_NODELAY on this socket. Without it the second of two small messages waits for the ACK
/// of the first: 40 ms, where the peer delays its ACKs. -1 is no socket, and nothing happens. Any
/// thread.
void send_at_once(int fd) noexcept;

}  // namespace fxagent
