// The 3C and 4C frames around a message, in formats 1 to 4 (ASCII) and 5 (binary, 4C alone).
// Source: SH-080008, 4.2 and 4.3; protocol/README.md has the layout.
#pragma once

#include <cstdint>
#include <string>

#include "protocol/bytes.h"
#include "protocol/mc/ethernet_frame.h"

namespace fxagent::mc {

struct SerialSettings {
  bool is_4c = true;  ///< else 3C, whose route ends with the PC number
  std::uint32_t format = 1;
  bool sum_check = true;
  std::uint8_t station = 0;
  Route route;

  Code code() const { return format == 5 ? Code::binary : Code::ascii; }
};

inline constexpr std::uint8_t kStx = 0x02;
inline constexpr std::uint8_t kEtx = 0x03;
inline constexpr std::uint8_t kEnq = 0x05;
inline constexpr std::uint8_t kAck = 0x06;
inline constexpr std::uint8_t kLf = 0x0A;
inline constexpr std::uint8_t kCr = 0x0D;
inline constexpr std::uint8_t kDle = 0x10;  ///< begins and ends frames of format 5, doubled inside
inline constexpr std::uint8_t kNak = 0x15;

/// `block` goes into format 2 alone, whose answers have it again.
Bytes serial_request(const SerialSettings& settings, std::uint8_t block, ByteView message);

/// Characters of an answer with this many of data, none of which is a doubled 10h; 0: no data.
std::size_t serial_answer_length(const SerialSettings& settings, std::size_t data);

/// How many bytes of `request` and of an answer that brings so many characters of data, none of
/// which is a 10h, are there only to double another.
std::size_t serial_doubles(const SerialSettings& settings, ByteView request, std::size_t data);

/// What was received, looked through for the answer to one request.
struct SerialAnswer {
  enum class State : std::uint8_t {
    incomplete,
    data,
    done,
    refused,
    wrong,
  } state = State::incomplete;
  Bytes data;
  std::uint16_t end_code = 0;
  std::size_t began = 0;
  std::size_t end = 0;
  std::string error;  ///< wrong: what is
};
/// The answer to a request with this block number, that brings `data` characters of data or, where
/// that is 0, none. Echoes, frames of other stations and answers of the other kind are passed over.
SerialAnswer serial_answer(const SerialSettings& settings, std::uint8_t block, std::size_t data,
                           ByteView rx);

/// Whether these bytes could be the beginning of an answer to anything.
bool may_be_serial_answer(const SerialSettings& settings, ByteView bytes);

/// The sum as its two digits stand on the wire: low 8 bits.
std::uint8_t serial_sum(ByteView bytes);

/// A frame of format 5 without its doubling.
struct Undoubled {
  enum class State : std::uint8_t { good, incomplete, wrong } state = State::incomplete;
  Bytes content;        ///< between DLE STX and DLE ETX, the length included
  std::size_t end = 0;  ///< behind DLE ETX; of a wrong one where to go on
};
/// `rx[at]` and the byte behind it are DLE STX.
Undoubled undoubled(ByteView rx, std::size_t at);

/// Frame id and route: "F90000FF00", or eight bytes.
Bytes serial_header(const SerialSettings& settings);

}  // namespace fxagent::mc
