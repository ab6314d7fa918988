// Stands where Paho reads from its sockets. Keeps packets off it that no broker should send: Paho
// 1.3 reads the length of a packet and then all of it into memory, before anybody is asked, 250 MB
// where a broker says so, several times over. What may come is in incoming_packets.h. And tells
// which socket is the broker's, which Paho hides.
#pragma once

#include <chrono>
#include <cstddef>

namespace fxagent {

/// A connection of Paho's on this socket has just been made, and this thread reads it.
void follow_packets(int fd) noexcept;

/// A packet that was not read.
struct RefusedPacket {
  std::size_t bytes = 0;  ///< 0: none was refused
  std::size_t most = 0;   ///< that could be; 0: no message, since CONNACK had not come
};

/// What was refused on this thread since the last call. Its connection is over: Paho is told that
/// the socket failed, and calls back on the same thread.
RefusedPacket take_refused_packet() noexcept;

/// The socket that this thread has read from last, with TLS or without; -1: none yet. In a callback
/// of Paho about a packet it is the socket that brought the packet, since Paho calls back on the
/// thread that has just read it.
int last_socket_read() noexcept;

/// When a peer has closed a connection without TLS that this thread read from, for the last time;
/// the epoch: never.
std::chrono::steady_clock::time_point last_closed_by_peer() noexcept;

}  // namespace fxagent
