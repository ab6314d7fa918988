// Control characters (ASCII) that begin, end and acknowledge frames of serial lines.
#pragma once

#include <cstdint>

namespace fxagent {

inline constexpr std::uint8_t kStx = 0x02;
inline constexpr std::uint8_t kEtx = 0x03;
inline constexpr std::uint8_t kEot = 0x04;
inline constexpr std::uint8_t kEnq = 0x05;
inline constexpr std::uint8_t kAck = 0x06;
inline constexpr std::uint8_t kLf = 0x0A;
inline constexpr std::uint8_t kCl = 0x0C;
inline constexpr std::uint8_t kCr = 0x0D;
inline constexpr std::uint8_t kDle =
    0x10;  ///< begins and ends 4C frames of format 5; doubled inside
inline constexpr std::uint8_t kNak = 0x15;

}  // namespace fxagent
