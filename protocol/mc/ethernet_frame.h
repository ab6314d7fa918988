// 3E and 4E frames around a message, in binary and ASCII code.
// Source: SH-080008, 4.4 and 4.5; JY997D56001. Offsets are in protocol/README.md.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "protocol/mc/dialect.h"
#include "protocol/value/bytes.h"

namespace fxagent::mc {

inline constexpr std::size_t kEndCode = 2;  ///< bytes of an end code in binary code

/// Returns the route in `wire`, bytes or digits. That of a 3C frame ends with the PC number.
Route route_in(Code code, ByteView wire);
/// Returns "network 0, PC FF, module I/O 03FF, station 00".
std::string to_string(const Route& route);

Bytes ethernet_request(const Dialect& dialect, std::uint16_t serial, ByteView message);
/// Returns the characters of an answer with `data` characters of data.
std::size_t ethernet_answer_length(const Dialect& dialect, std::size_t data);

/// A frame found in the received bytes.
struct EthernetFrame {
  enum class State : std::uint8_t { good, incomplete, wrong } state = State::incomplete;
  bool is_request = false;
  std::uint16_t serial = 0;
  Route route{};
  ByteView content{};  ///< after the length: timer and message, or end code and data
  std::size_t end = 0;
  std::string error{};  ///< wrong: the reason; nothing after it can be decoded
};
/// Returns the frame that begins at `at`. `content` points into `rx`.
EthernetFrame ethernet_frame(bool numbered, Code code, ByteView rx, std::size_t at);

}  // namespace fxagent::mc
