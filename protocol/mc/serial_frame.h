// 1C, 3C and 4C frames around a message, in formats 1 to 4 (ASCII) and 5 (binary, 4C only).
// Source: SH-080008, 4.2 and 4.3; protocol/README.md has the layout. Dialect::code must be binary
// for format 5, and otherwise ascii.
#pragma once

#include <cstdint>

#include "protocol/mc/ethernet_frame.h"
#include "protocol/value/bytes.h"

namespace fxagent::mc {

/// Builds a request. Only format 2 carries `block`; its answers repeat it.
Bytes serial_request(const Dialect& dialect, std::uint8_t block, ByteView message);

/// Returns the characters of an answer with `data` characters of data, without doubled 10h.
std::size_t serial_answer_length(const Dialect& dialect, std::size_t data);

/// Returns the bytes of `request` and of its answer that only double another byte. The answer has
/// `data` characters of data, none of which is a 10h.
std::size_t serial_doubles(const Dialect& dialect, ByteView request, std::size_t data);

/// Searches `rx` for the answer to a request with this block number. The answer has `data`
/// characters of data; 0: none. Skips echoes, frames of other stations and answers of the other
/// kind. The image is the data as received, in format 5 without the doubling. A refusal has no
/// text. In 1C its code is 0 if it is not a hex number; the codec reads it again.
Decoded serial_answer(const Dialect& dialect, std::uint8_t block, std::size_t data, ByteView rx);

/// True if these bytes could begin an answer to any request.
bool may_be_serial_answer(const Dialect& dialect, ByteView bytes);

/// A frame of format 5 with its doubling removed.
struct Undoubled {
  enum class State : std::uint8_t { good, incomplete, wrong } state = State::incomplete;
  Bytes content;        ///< between DLE STX and DLE ETX, including the length
  std::size_t end = 0;  ///< after DLE ETX; wrong: where the search continues
};
/// Requires that `rx[at]` and the next byte are DLE STX.
Undoubled undoubled(ByteView rx, std::size_t at);

/// Returns frame id and route: "F90000FF00", or eight bytes; for 1C station and PC, "00FF".
Bytes serial_header(const Dialect& dialect);

}  // namespace fxagent::mc
