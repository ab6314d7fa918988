// Frames around a Modbus PDU: RTU, ASCII and TCP.
// Sources: MODBUS over Serial Line V1.02, 2.5; MODBUS Messaging on TCP/IP V1.0b, 3.1.
#pragma once

#include <cstdint>
#include <string>

#include "protocol/value/bytes.h"

namespace fxagent::modbus {

enum class Framing : std::uint8_t { rtu, ascii, tcp };

/// Characters of the longest ASCII frame, with colon and CR LF.
constexpr std::size_t kLongestAscii = 513;

/// Returns the CRC-16 of an RTU frame. It follows the PDU, low byte first.
std::uint16_t crc(ByteView bytes);
/// Returns the LRC of an ASCII frame: of unit and PDU, before they are written as hex digits.
std::uint8_t lrc(ByteView bytes);

/// Returns the frame of `unit` and `pdu`. Only TCP uses `transaction`.
Bytes framed(Framing framing, std::uint8_t unit, ByteView pdu, std::uint16_t transaction);
/// Returns the bytes on the wire of a PDU of this length.
std::size_t framed_length(Framing framing, std::size_t pdu_bytes);

/// A frame found in the received bytes.
struct Frame {
  enum class State : std::uint8_t { good, incomplete, wrong } state = State::incomplete;
  std::uint8_t unit = 0;
  std::uint16_t transaction = 0;  ///< TCP
  Bytes pdu{};                    ///< also set if only the sum is wrong
  std::string sum_given{};        ///< CRC or LRC in hex, in wire order; empty on TCP
  std::string sum_computed{};
  std::size_t end = 0;  ///< end of the frame, good or wrong
  std::string error{};  ///< wrong: the reason
};

/// Returns the RTU frame that begins at `at` and whose PDU has `pdu_bytes`. The frame itself does
/// not contain its length.
Frame rtu_frame(ByteView rx, std::size_t at, std::size_t pdu_bytes);
/// Returns the first ASCII frame from `at` on. Skips bytes before its ':'.
Frame ascii_frame(ByteView rx, std::size_t at);
/// Returns the TCP frame that begins at `at`. Wrong: it has no Modbus header, so no later frame can
/// be found. `least` is the smallest length that its header may give: 3 for an answer, 2 for a
/// request.
Frame tcp_frame(ByteView rx, std::size_t at, std::size_t least = 3);

}  // namespace fxagent::modbus
