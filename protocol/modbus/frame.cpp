#include "protocol/modbus/frame.h"

#include <algorithm>

#include "protocol/encoding.h"

namespace fxagent::modbus {
namespace {

// Transaction, protocol, length: the bytes before those that the length counts.
constexpr std::size_t kMbap = 6;
// The length counts the unit and a PDU of up to 253 bytes.
constexpr std::size_t kLongest = 254;

Frame wrong(std::size_t end, std::string error) {
  return {.state = Frame::State::wrong, .end = end, .error = std::move(error)};
}

void judge_sum(Frame& frame, std::string_view name) {
  const bool right = frame.sum_given == frame.sum_computed;
  frame.state = right ? Frame::State::good : Frame::State::wrong;
  if (!right)
    frame.error =
        std::string(name) + " " + frame.sum_given + " given, " + frame.sum_computed + " computed";
}

std::uint16_t big_endian(ByteView bytes) {
  return static_cast<std::uint16_t>(bytes[0] << 8 | bytes[1]);
}

}  // namespace

std::uint16_t crc(ByteView bytes) {
  std::uint16_t value = 0xFFFF;
  for (const std::uint8_t byte : bytes) {
    value ^= byte;
    for (int bit = 0; bit < 8; ++bit) {
      const bool carry = (value & 1) != 0;
      value = static_cast<std::uint16_t>(value >> 1);
      if (carry) value ^= 0xA001;
    }
  }
  return value;
}

std::uint8_t lrc(ByteView bytes) { return static_cast<std::uint8_t>(-byte_sum(bytes)); }

Bytes framed(Framing framing, std::uint8_t unit, ByteView pdu, std::uint16_t transaction) {
  Bytes frame;
  frame.reserve(framed_length(framing, pdu.size()));
  frame.push_back(unit);
  frame.insert(frame.end(), pdu.begin(), pdu.end());
  const auto low = [](std::size_t number) { return static_cast<std::uint8_t>(number); };
  switch (framing) {
    case Framing::rtu: {
      const std::uint16_t sum = crc(frame);
      frame.insert(frame.end(), {low(sum), low(sum >> 8U)});
      break;
    }
    case Framing::ascii: {
      frame.push_back(lrc(frame));
      Bytes text{':'};
      for (const std::uint8_t byte : frame) append_hex(text, byte, 2);
      text.insert(text.end(), {'\r', '\n'});
      return text;
    }
    case Framing::tcp: {
      const std::size_t length = frame.size();
      frame.insert(frame.begin(), {low(transaction >> 8U), low(transaction), 0, 0,
                                   low(length >> 8U), low(length)});
      break;
    }
  }
  return frame;
}

std::size_t framed_length(Framing framing, std::size_t pdu_bytes) {
  if (framing == Framing::ascii) return 1 + 2 * (1 + pdu_bytes + 1) + 2;
  return 1 + pdu_bytes + (framing == Framing::rtu ? 2 : kMbap);
}

Frame rtu_frame(ByteView rx, std::size_t at, std::size_t pdu_bytes) {
  Frame frame;
  const std::size_t length = framed_length(Framing::rtu, pdu_bytes);
  if (rx.size() < at + length) return frame;
  const ByteView bytes = rx.subspan(at, length);
  const std::uint16_t computed = crc(bytes.first(length - 2));
  frame.unit = bytes[0];
  frame.pdu.assign(bytes.begin() + 1, bytes.end() - 2);
  frame.end = at + length;
  frame.sum_given = to_hex(bytes.last(2));
  frame.sum_computed = hex_text(computed & 0xFFU, 2) + " " + hex_text(computed >> 8U, 2);
  judge_sum(frame, "CRC");
  return frame;
}

Frame ascii_frame(ByteView rx, std::size_t at) {
  const auto from = rx.begin() + static_cast<std::ptrdiff_t>(std::min(at, rx.size()));
  auto colon = std::find(from, rx.end(), ':');
  const auto cr = std::find(colon, rx.end(), '\r');
  if (cr == rx.end() || cr + 1 == rx.end()) {
    if (rx.end() - colon > static_cast<std::ptrdiff_t>(kLongestAscii))
      return wrong(rx.size(), "no end of frame within 513 characters");
    return {};
  }
  for (auto again = colon; again != cr; again = std::find(again + 1, cr, ':')) colon = again;
  const auto end = static_cast<std::size_t>(cr - rx.begin()) + 2;
  if (cr[1] != '\n') return wrong(end, "CR without LF");
  if ((cr - colon - 1) % 2 != 0) return wrong(end, "an odd number of hex digits");
  const auto digits = bytes_in(ByteView(colon + 1, cr));
  if (!digits) return wrong(end, digits.error().text);
  const Bytes& bytes = *digits;
  if (bytes.size() < 3) return wrong(end, "too short for unit, function and LRC");
  Frame frame;
  frame.unit = bytes.front();
  frame.pdu.assign(bytes.begin() + 1, bytes.end() - 1);
  frame.end = end;
  frame.sum_given = hex_text(bytes.back(), 2);
  frame.sum_computed = hex_text(lrc(ByteView(bytes).first(bytes.size() - 1)), 2);
  judge_sum(frame, "LRC");
  return frame;
}

Frame tcp_frame(ByteView rx, std::size_t at, std::size_t least) {
  Frame frame;
  if (rx.size() < at + kMbap) return frame;
  const ByteView head = rx.subspan(at, kMbap);
  const std::uint16_t protocol = big_endian(head.subspan(2));
  const std::uint16_t length = big_endian(head.subspan(4));
  if (protocol != 0)
    return wrong(rx.size(), "protocol " + hex_text(protocol, 4) + " in the header, Modbus is 0000");
  if (length < least || length > kLongest)
    return wrong(rx.size(), "length " + std::to_string(length) + " in the header: " +
                                std::to_string(least) + " to 254 bytes follow it in Modbus");
  if (rx.size() < at + kMbap + length) return frame;
  const ByteView body = rx.subspan(at + kMbap, length);
  frame.state = Frame::State::good;
  frame.transaction = big_endian(head);
  frame.unit = body[0];
  frame.pdu.assign(body.begin() + 1, body.end());
  frame.end = at + kMbap + length;
  return frame;
}

}  // namespace fxagent::modbus
