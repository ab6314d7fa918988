// The three frames around a Modbus PDU: RTU, ASCII and TCP.
// Sources: MODBUS over Serial Line V1.02, 2.5; MODBUS Messaging on TCP/IP V1.0b, 3.1.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "protocol/bytes.h"

namespace fxagent::modbus {

enum class Framing : std::uint8_t { rtu, ascii, tcp };

/// CRC-16 of an RTU frame; it stands low byte first behind the PDU.
std::uint16_t crc(ByteView bytes);
/// LRC of an ASCII frame: unit and PDU, before they are written as hex digits.
std::uint8_t lrc(ByteView bytes);

/// `unit` and `pdu` as they go onto the wire. `transaction` is used by TCP alone.
Bytes framed(Framing framing, std::uint8_t unit, ByteView pdu, std::uint16_t transaction);
/// Bytes on the wire of a PDU of this length.
std::size_t framed_length(Framing framing, std::size_t pdu_bytes);

/// One frame found in what was received.
struct Frame {
  enum class State : std::uint8_t { good, incomplete, wrong } state = State::incomplete;
  std::uint8_t unit = 0;
  std::uint16_t transaction = 0;  ///< TCP
  Bytes pdu;                      ///< also where nothing but the sum is wrong
  std::string sum_given;          ///< CRC or LRC in hex, in the order of the wire; empty on TCP
  std::string sum_computed;
  std::size_t end = 0;  ///< behind the frame, good or wrong
  std::string error;    ///< wrong: what is
};

/// The RTU frame that begins at `at` and whose PDU has `pdu_bytes` (its length cannot be told from
/// it alone).
Frame rtu_frame(ByteView rx, std::size_t at, std::size_t pdu_bytes);
/// The first ASCII frame from `at` on; what stands before its ':' is passed over.
Frame ascii_frame(ByteView rx, std::size_t at);
/// The TCP frame that begins at `at`. Wrong: no Modbus header, so that what follows has no frames.
/// `least` is the smallest length that its header may give: 3 for an answer, 2 for a request.
Frame tcp_frame(ByteView rx, std::size_t at, std::size_t least = 3);

}  // namespace fxagent::modbus
