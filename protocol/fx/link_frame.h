// The control characters of computer-link frames; for the codec's own files.
#pragma once

#include <cstdint>

namespace fxagent::fx::link {

inline constexpr std::uint8_t kStx = 0x02;
inline constexpr std::uint8_t kEtx = 0x03;
inline constexpr std::uint8_t kEot = 0x04;
inline constexpr std::uint8_t kEnq = 0x05;
inline constexpr std::uint8_t kAck = 0x06;
inline constexpr std::uint8_t kLf = 0x0A;
inline constexpr std::uint8_t kCl = 0x0C;
inline constexpr std::uint8_t kCr = 0x0D;
inline constexpr std::uint8_t kNak = 0x15;
/// Control character, station and PLC number: the whole of an ACK, the head of everything else.
inline constexpr std::uint32_t kHeader = 5;

}  // namespace fxagent::fx::link
