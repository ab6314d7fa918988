// Stands where Paho reads from its sockets. Keeps packets off it that no broker should send: Paho
// 1.3 reads the length of a packet and then all of it into memory, before anybody is asked, 250 MB
// where a broker says so, several times over. And tells which socket is the broker's, which Paho
// hides.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>

namespace fxagent {

/// Bytes of the longest packet that is read. Told to the broker on MQTT 5. A command is 64 KiB at
/// most, and one that is far too large must still be answered.
inline constexpr std::uint32_t kMaxPacketIn = 16 << 20;

/// Length of a longer packet that was refused on this thread since the last call; 0: none was. Its
/// connection is over: Paho is told that the socket failed, and calls back on the same thread.
std::size_t take_refused_packet() noexcept;

/// The socket that this thread has read from last, with TLS or without; -1: none yet. In a callback
/// of Paho about a packet it is the socket that brought the packet, since Paho calls back on the
/// thread that has just read it.
int last_socket_read() noexcept;

/// When a peer has closed a connection without TLS that this thread read from, for the last time;
/// the epoch: never.
std::chrono::steady_clock::time_point last_closed_by_peer() noexcept;

}  // namespace fxagent
