// Control characters and envelope of programming-port frames. Only for the files of this codec.
#pragma once

#include <cstdint>

namespace fxagent::fx {

inline constexpr std::uint8_t kStx = 0x02;
inline constexpr std::uint8_t kEtx = 0x03;
inline constexpr std::uint8_t kEnq = 0x05;
inline constexpr std::uint8_t kAck = 0x06;
inline constexpr std::uint8_t kNak = 0x15;
/// STX before the payload; ETX and two digits of sum after it.
inline constexpr std::uint32_t kEnvelope = 4;

}  // namespace fxagent::fx
