// Frames of the FX programming port as a PLC and its programming tool send them, written out for
// these tests: the agent's frames are compared with them, never with its own encoder.
// Classic commands: 0 reads, 1 writes bytes, 7 and 8 force one bit; numbers are ASCII hex.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "protocol/value/bytes.h"

namespace fxagent::test {

inline const Bytes kEnq{0x05};
inline const Bytes kAck{0x06};
inline const Bytes kNak{0x15};

// Byte addresses of the classic map, and bit addresses of its forces.
inline constexpr unsigned kD100 = 0x10C8;
inline constexpr unsigned kD101 = 0x10CA;
inline constexpr unsigned kD200 = 0x1190;
inline constexpr unsigned kD201 = 0x1192;
inline constexpr unsigned kM0 = 0x0100;
inline constexpr unsigned kM96 = 0x010C;  // the byte that contains M100, as bit 4
inline constexpr unsigned kM8000 = 0x01E0;
inline constexpr unsigned kD8001 = 0x0E02;
inline constexpr unsigned kD8101 = 0x0ECA;
inline constexpr unsigned kForceM100 = 0x0864;
inline constexpr unsigned kForceM8037 = 0x0F25;

inline std::string hex_text(unsigned value, int digits) {
  std::string text(static_cast<std::size_t>(digits), '0');
  for (int i = digits - 1; i >= 0; --i, value >>= 4)
    text[static_cast<std::size_t>(i)] = "0123456789ABCDEF"[value & 15U];
  return text;
}

/// Builds STX, the text, ETX, and the sum of everything after STX.
inline Bytes port_frame(std::string_view text) {
  Bytes frame{0x02};
  unsigned sum = 0x03;
  for (const char c : text) {
    frame.push_back(static_cast<std::uint8_t>(c));
    sum += static_cast<std::uint8_t>(c);
  }
  frame.push_back(0x03);
  for (const char c : hex_text(sum & 0xFFU, 2)) frame.push_back(static_cast<std::uint8_t>(c));
  return frame;
}

inline std::string hex_of(const Bytes& bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) text += hex_text(byte, 2);
  return text;
}

inline Bytes read_frame(unsigned address, unsigned bytes) {
  return port_frame("0" + hex_text(address, 4) + hex_text(bytes, 2));
}
inline Bytes write_frame(unsigned address, const Bytes& bytes) {
  return port_frame("1" + hex_text(address, 4) + hex_text(static_cast<unsigned>(bytes.size()), 2) +
                    hex_of(bytes));
}
inline Bytes force_frame(unsigned bit_address, bool on) {
  return port_frame((on ? "7" : "8") + hex_text(bit_address & 0xFFU, 2) +
                    hex_text(bit_address >> 8, 2));
}
inline Bytes data_frame(const Bytes& bytes) { return port_frame(hex_of(bytes)); }
inline Bytes word(unsigned value) {
  return {static_cast<std::uint8_t>(value & 0xFFU), static_cast<std::uint8_t>(value >> 8)};
}
inline Bytes word_frame(unsigned value) { return data_frame(word(value)); }

inline Bytes joined(Bytes left, const Bytes& right) {
  left.insert(left.end(), right.begin(), right.end());
  return left;
}

}  // namespace fxagent::test
