// TCP_NODELAY for a connection that a library has made and does not expose.
#pragma once

namespace fxagent {

/// Sets TCP_NODELAY on this socket. Without it the second of two small messages waits for the ACK
/// of the first: 40 ms, if the peer delays its ACKs. Does nothing if `fd` is -1. Any thread.
void send_at_once(int fd) noexcept;

}  // namespace fxagent
