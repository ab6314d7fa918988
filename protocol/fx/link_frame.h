// Control characters of computer-link frames. Only for the files of this codec.
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
/// Control character, station and PLC number: a whole ACK, or the head of any other frame.
inline constexpr std::uint32_t kHeader = 5;

}  // namespace fxagent::fx::link
