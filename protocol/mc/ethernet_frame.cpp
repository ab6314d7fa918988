#include "protocol/mc/ethernet_frame.h"

#include <optional>

#include "protocol/mc/body.h"

namespace fxagent::mc {
namespace {

// Bytes of the header including the length: subheader, (serial and reserved,) route, length.
constexpr std::size_t kHeader3E = 9;
constexpr std::size_t kHeader4E = 13;
constexpr std::size_t kSerial = 2;
constexpr std::size_t kRoute = 5;
constexpr std::size_t kLength = 2;
constexpr std::size_t kTimer = 2;
// No frame is longer. A header with a greater length is invalid.
constexpr std::size_t kLongest = 8192;

constexpr std::size_t header_size(bool numbered) { return numbered ? kHeader4E : kHeader3E; }

struct Subheader {
  bool is_request;
  bool is_numbered;
};
/// Returns the subheader at the start of `bytes` if it is in this code: 50 00 of 3E or 54 00 of 4E,
/// in an answer D0 00 or D4 00. `bytes` must hold two bytes of this code.
std::optional<Subheader> subheader_in(Code code, ByteView bytes) {
  constexpr std::uint32_t kAnswer = 0x80;
  constexpr std::uint32_t kNumbered = 0x04;
  const auto first = number_at(code, bytes, 0, 1);
  const bool is_known = first && (*first & ~(kAnswer | kNumbered)) == 0x50;
  if (!is_known || number_at(code, bytes, 1, 1) != 0U) return std::nullopt;
  return Subheader{(*first & kAnswer) == 0, (*first & kNumbered) != 0};
}

EthernetFrame wrong(ByteView rx, std::string error) {
  return {.state = EthernetFrame::State::wrong, .end = rx.size(), .error = std::move(error)};
}

/// Describes the bytes that stand in place of the expected subheader.
std::string why_foreign(bool numbered, Code code, ByteView bytes) {
  const std::string ours = numbered ? "4E" : "3E";
  if (const auto other = subheader_in(code, bytes))
    return std::string("a ") + (other->is_numbered ? "4E" : "3E") + " frame instead of " + ours +
           ": the protocol is mc-" + (other->is_numbered ? "4e" : "3e");
  if (bytes.size() >= 4) {
    const bool ascii = code == Code::ascii;
    if (subheader_in(ascii ? Code::binary : Code::ascii, bytes))
      return std::string("an answer in ") + (ascii ? "binary" : "ASCII") +
             " code: set `code` to that of the port (Communication Data Code)";
  }
  // A 1E port answers an unknown command 50 with 50 + 80h and end code 50.
  const auto first = number_at(code, bytes, 0, 1);
  const auto second = number_at(code, bytes, 1, 1);
  if (first && second && (*first == 0xD0 || *first == 0xD4) && *second == 0x50)
    return "an answer in a 1E frame: set protocol to mc-1e";
  return "subheader " + to_hex(bytes.first(std::min<std::size_t>(bytes.size(), 4))) +
         " is not one of " + ours;
}

}  // namespace

Route route_in(Code code, ByteView wire) {
  const auto number = [&](std::size_t at, std::size_t bytes) {
    return number_at(code, wire, at, bytes).value_or(0);
  };
  Route route;
  route.network = static_cast<std::uint8_t>(number(0, 1));
  route.pc = static_cast<std::uint8_t>(number(1, 1));
  if (wire.size() == wire_size(code, 2)) return route;
  route.module_io = static_cast<std::uint16_t>(number(2, 2));
  route.module_station = static_cast<std::uint8_t>(number(4, 1));
  return route;
}

std::string to_string(const Route& route) {
  return "network " + std::to_string(route.network) + ", PC " + hex_text(route.pc, 2) +
         ", module I/O " + hex_text(route.module_io, 4) + ", station " +
         hex_text(route.module_station, 2);
}

Bytes ethernet_request(const Dialect& dialect, std::uint16_t serial, ByteView message) {
  Bytes frame;
  const Code code = dialect.code;
  const bool numbered = dialect.frame == Frame::e4;
  frame.reserve(wire_size(code, header_size(numbered) + kTimer) + message.size());
  // The subheader is written in this order in both codes.
  append_number(code, frame, numbered ? 0x54 : 0x50, 1);
  append_number(code, frame, 0, 1);
  if (numbered) {
    append_number(code, frame, serial, kSerial);
    append_number(code, frame, 0, 2);
  }
  append_number(code, frame, dialect.route.network, 1);
  append_number(code, frame, dialect.route.pc, 1);
  append_number(code, frame, dialect.route.module_io, 2);
  append_number(code, frame, dialect.route.module_station, 1);
  append_number(code, frame, static_cast<std::uint32_t>(wire_size(code, kTimer) + message.size()),
                2);
  append_number(code, frame, dialect.timer, kTimer);
  frame.insert(frame.end(), message.begin(), message.end());
  return frame;
}

std::size_t ethernet_answer_length(const Dialect& dialect, std::size_t data) {
  return wire_size(dialect.code, header_size(dialect.frame == Frame::e4) + kEndCode) + data;
}

EthernetFrame ethernet_frame(bool numbered, Code code, ByteView rx, std::size_t at) {
  const ByteView bytes = rx.subspan(at);
  // Four bytes distinguish ASCII from binary. A 1E answer in binary has only two.
  if (bytes.size() < wire_size(code, 2)) return {};
  const auto subheader = subheader_in(code, bytes);
  if (!subheader && bytes.size() < 4 && bytes[1] != 0x50)
    return {};  // two more bytes may identify it
  if (!subheader || subheader->is_numbered != numbered)
    return wrong(rx, why_foreign(numbered, code, bytes));
  const std::size_t header = wire_size(code, header_size(numbered));
  if (bytes.size() < header) return {};
  if (code == Code::ascii && !is_hex(bytes.first(header)))
    return wrong(rx, "the header " + to_hex(bytes.first(header)) + " is not hex digits");
  EthernetFrame frame;
  frame.is_request = subheader->is_request;
  if (numbered) frame.serial = static_cast<std::uint16_t>(*number_at(code, bytes, 2, kSerial));
  const std::size_t behind = header_size(numbered) - kLength;
  frame.route =
      route_in(code, bytes.subspan(wire_size(code, behind - kRoute), wire_size(code, kRoute)));
  const std::size_t length = *number_at(code, bytes, behind, kLength);
  if (length < wire_size(code, kEndCode) || length > wire_size(code, kLongest))
    return wrong(rx, "length " + std::to_string(length) +
                         " in the header: " + std::to_string(wire_size(code, kEndCode)) + " to " +
                         std::to_string(wire_size(code, kLongest)) + " are possible");
  if (bytes.size() < header + length) return frame;
  frame.state = EthernetFrame::State::good;
  frame.content = bytes.subspan(header, length);
  frame.end = at + header + length;
  return frame;
}

}  // namespace fxagent::mc
