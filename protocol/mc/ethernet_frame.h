// The 3E and 4E frames around a message, in binary and ASCII code.
// Source: SH-080008, 4.4 and 4.5; JY997D56001. Offsets are in protocol/README.md.
#pragma once

#include <cstdint>
#include <string>

#include "protocol/bytes.h"
#include "protocol/mc/dialect.h"

namespace fxagent::mc {

/// The access route: which station is meant. The defaults are the one that is connected.
struct Route {
  std::uint8_t network = 0;
  std::uint8_t pc = 0xFF;
  std::uint16_t module_io = 0x03FF;
  std::uint8_t module_station = 0;
  friend bool operator==(const Route&, const Route&) = default;
};
/// "network 0, PC FF, module I/O 03FF, station 00".
std::string to_string(const Route& route);

struct EthernetSettings {
  bool numbered = false;  ///< 4E, which has a serial number; else 3E
  Code code = Code::binary;
  Route route;
  std::uint32_t timer = 16;  ///< monitoring timer, in units of 250 ms
};

Bytes ethernet_request(const EthernetSettings& settings, std::uint16_t serial, ByteView message);
/// Characters of an answer with this many of data.
std::size_t ethernet_answer_length(const EthernetSettings& settings, std::size_t data);

/// One frame found in what was received.
struct EthernetFrame {
  enum class State : std::uint8_t { good, incomplete, wrong } state = State::incomplete;
  bool is_request = false;
  std::uint16_t serial = 0;
  Route route;
  ByteView content;  ///< behind the length: timer and message, or end code and what follows it
  std::size_t end = 0;
  std::string error;  ///< wrong: why nothing behind it can be understood
};
/// The frame that begins at `at`; `content` lies in `rx`.
EthernetFrame ethernet_frame(bool numbered, Code code, ByteView rx, std::size_t at);

}  // namespace fxagent::mc
