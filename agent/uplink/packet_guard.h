// Keeps packets off Paho that no broker should send. Paho 1.3 reads the length of a packet and then
// all of it into memory, before anybody is asked: 250 MB where a broker says so, several times
// over.
#pragma once

#include <cstddef>
#include <cstdint>

namespace fxagent {

/// Bytes of the longest packet that is read. Told to the broker on MQTT 5. A command is 64 KiB at
/// most, and one that is far too large must still be answered.
inline constexpr std::uint32_t kMaxPacketIn = 16 << 20;

/// Length of a longer packet that was refused on this thread since the last call; 0: none was. Its
/// connection is over: Paho is told that the socket failed, and calls back on the same thread.
std::size_t take_refused_packet() noexcept;

}  // namespace fxagent
