#include "agent/field/bus/unexpected_bytes.h"

#include <algorithm>
#include <bit>
#include <functional>
#include <optional>
#include <string_view>

#include "protocol/catalog.h"
#include "protocol/explanation.h"

namespace fxagent {
namespace {

using Cause = UnexpectedBytes::Cause;

constexpr std::size_t kShown = 16;
constexpr std::uint8_t kStx = 0x02;
// A few bytes may match a pattern by chance.
constexpr std::size_t kFewBytes = 3;

bool is_even(std::uint8_t byte) { return std::popcount(byte) % 2 == 0; }

/// True for the characters of text protocols: their control characters and printable ASCII.
bool is_text(std::uint8_t byte) {
  constexpr std::string_view controls = "\x02\x03\x04\x05\x06\x0A\x0C\x0D\x15";
  return (byte >= ' ' && byte < 0x7F) || controls.find(static_cast<char>(byte)) != controls.npos;
}

std::string quoted(const Explanation& frame) { return "\"" + summary(frame) + "\""; }

/// Returns " of station 3" if the frame names its station or unit.
std::string whose(const Explanation& frame) {
  for (const auto& [name, meaning] : frame.fields)
    if (name == "station" || name == "unit")
      return std::string(" of ").append(name).append(" ").append(meaning);
  return {};
}

// ---- frames -------------------------------------------------------------------------------------

/// Recognises a PLC whose frame settings differ from the config. `frame` is valid in itself.
std::optional<UnexpectedBytes> other_settings(const DeviceConfig& device,
                                              const Explanation& frame) {
  if (device.protocol == nullptr || device.protocol->format_place.empty() || !device.options)
    return std::nullopt;
  const std::string place(device.protocol->format_place);
  const auto* format = option<std::int64_t>(*device.options, "format");
  if (format != nullptr && frame.format && *frame.format != *format) {
    const std::string theirs = std::to_string(*frame.format);
    return UnexpectedBytes{Cause::other_settings, "a frame of format " + theirs +
                                                      ": set format to " + theirs + ", or format " +
                                                      std::to_string(*format) + " in " + place};
  }
  const bool* has_sums = option<bool>(*device.options, "sum_check");
  const bool may_have_sum = frame.operation == "data" || frame.direction == Direction::request;
  if (has_sums != nullptr && may_have_sum && frame.checksum_given.has_value() != *has_sums)
    return UnexpectedBytes{
        Cause::other_settings,
        (*has_sums ? "a frame without a sum: set sum_check to false, or enable the sum check in "
                   : "a frame with a sum: set sum_check to true, or disable the sum check in ") +
            place};
  return std::nullopt;
}

std::optional<UnexpectedBytes> own_frame(const DeviceConfig& device, const Codec& codec,
                                         ByteView received) {
  const Explanation frame = codec.explain(received, std::nullopt);
  if (!frame.ok) return std::nullopt;
  if (auto other = other_settings(device, frame)) return other;
  if (frame.direction == Direction::request && !frame.ambiguous)
    return UnexpectedBytes{Cause::another_master,
                           "a request" + whose(frame) + ", " + quoted(frame) +
                               ": another master sends on this line; a line may have only one"};
  return UnexpectedBytes{Cause::another_master,
                         "a valid answer" + whose(frame) + ", " + quoted(frame) +
                             ", but not to this request: another station, another master, or a "
                             "late answer (timeout_ms)"};
}

/// The bytes may be a valid frame of several protocols. A frame that names its station is
/// preferred: more of it must be right.
std::optional<UnexpectedBytes> frame_of_another(const DeviceConfig& device, ByteView received) {
  std::optional<UnexpectedBytes> found;
  for (const ProtocolInfo& other : catalog()) {
    if (device.protocol == nullptr || other.name == device.protocol->name) continue;
    const auto codec = other.make(default_options(other));
    if (!codec) continue;
    const Explanation frame = (*codec)->explain(received, std::nullopt);
    const std::string of = whose(frame);
    if (!frame.ok || (found && of.empty())) continue;
    found =
        UnexpectedBytes{Cause::other_protocol,
                        "a valid frame of " + std::string(other.name) + of + ", " + quoted(frame) +
                            ": set protocol, or put the devices on separate lines"};
    if (!of.empty()) break;
  }
  return found;
}

/// Returns the protocols whose answers begin so, as "fx-programming-port, fx-computer-link".
std::string protocols_of(std::uint8_t first) {
  std::string names;
  for (const ProtocolInfo& info : catalog())
    if (info.text_begins_with == first) names.append(names.empty() ? "" : ", ").append(info.name);
  return names;
}

/// Recognises the beginning of a truncated or garbled frame.
std::optional<UnexpectedBytes> beginning_of_another(const DeviceConfig& device, ByteView received) {
  if (device.protocol == nullptr || received.size() <= kFewBytes) return std::nullopt;
  if (received[0] == device.protocol->text_begins_with) return std::nullopt;
  const ByteView behind = received.subspan(1);
  const bool is_ascii =
      received[0] == ':' && std::ranges::all_of(behind, [](std::uint8_t byte) {
        return hex_digit(byte) >= 0 || byte == '\r' || byte == '\n' || byte == ':';
      });
  if (is_ascii)
    return UnexpectedBytes{Cause::other_protocol,
                           "a colon and hex digits: set protocol to " + protocols_of(':')};
  if (received[0] == kStx && std::ranges::all_of(behind, is_text))
    return UnexpectedBytes{Cause::other_protocol,
                           "STX and text: set protocol to the PLC's, one of " + protocols_of(kStx)};
  return std::nullopt;
}

// ---- characters ---------------------------------------------------------------------------------

/// A line without parity receives the sender's parity bit as bit 7.
std::optional<UnexpectedBytes> parity_in_bit_7(ByteView received) {
  const bool has_bit_7 = std::ranges::any_of(received, [](std::uint8_t b) { return b > 0x7F; });
  const bool is_text_below =
      std::ranges::all_of(received, [](std::uint8_t b) { return is_text(b & 0x7F); });
  const bool even = std::ranges::all_of(received, is_even);
  const bool odd = std::ranges::none_of(received, is_even);
  if (!has_bit_7 || !is_text_below || (!even && !odd)) return std::nullopt;
  return UnexpectedBytes{Cause::parity, std::string("7 bits with ") + (even ? "even" : "odd") +
                                            " parity in bit 7: set data_bits to 7 and parity to " +
                                            (even ? "even" : "odd") +
                                            ", here or in the serial server"};
}

/// A line with parity delivers a character of wrong parity as 00.
std::optional<UnexpectedBytes> zeros_among_text(ByteView received) {
  const auto zeros = std::ranges::count(received, 0);
  const auto good = std::ranges::count_if(received, is_text);
  if (zeros == 0 || good == 0 || zeros + good != std::ssize(received) ||
      4 * good < std::ssize(received))
    return std::nullopt;
  return UnexpectedBytes{Cause::parity,
                         "text with 00 for each character of wrong parity: set parity and "
                         "data_bits to those of the device (8 bits without parity?)"};
}

/// Recognises a sender that is slower than the line: each of its bits is received several times.
std::optional<UnexpectedBytes> bits_in_groups(ByteView received) {
  if (received.size() < kFewBytes) return std::nullopt;
  if (std::ranges::count(received, 0) == std::ssize(received))
    return UnexpectedBytes{Cause::speed,
                           "only characters with errors, which arrive as 00: compare baud with the "
                           "device's, then parity (odd?)"};
  const auto in_fours = [](std::uint8_t b) {
    return b == 0 || b == 0x78 || b == 0x80 || b == 0xF8;
  };
  const auto in_pairs = [](std::uint8_t b) {
    return (b & 1) == 0 && ((b >> 1 ^ b >> 2) & 1) == 0 && ((b >> 3 ^ b >> 4) & 1) == 0 &&
           ((b >> 5 ^ b >> 6) & 1) == 0;
  };
  const bool fours = std::ranges::all_of(received, in_fours);
  if (!fours && !std::ranges::all_of(received, in_pairs)) return std::nullopt;
  return UnexpectedBytes{
      Cause::speed, std::string("bits that arrive in ") + (fours ? "fours" : "pairs") +
                        ": the device is slower, set baud to " + (fours ? "a quarter" : "half") +
                        " of its present value"};
}

std::optional<UnexpectedBytes> no_text(ByteView received) {
  const auto foreign = std::ranges::count_if(received, std::not_fn(is_text));
  if (received.size() < kFewBytes || 3 * foreign < std::ssize(received)) return std::nullopt;
  return UnexpectedBytes{Cause::speed,
                         "bytes that are not text, although the protocol is: compare baud with the "
                         "device's, then data_bits and parity; or it is another protocol"};
}

}  // namespace

UnexpectedBytes looks_like(const DeviceConfig& device, const Codec& codec, ByteView asked,
                           ByteView received) {
  // Speed and parity do not exist over Ethernet.
  const bool is_on_line = device.protocol == nullptr || device.protocol->on_serial;
  UnexpectedBytes unknown{
      Cause::unknown, is_on_line
                          ? "nothing known: if it is rare, noise; otherwise compare baud, "
                            "data_bits and parity of line and device, and look for another master"
                          : "nothing known: does another service or protocol answer at this port? "
                            "Compare protocol and its settings with the device's"};
  if (received.empty()) return unknown;
  const bool returned = !asked.empty() && std::ranges::mismatch(asked, received).in1 == asked.end();
  if (returned)
    return {Cause::echo,
            "the request itself, which the line returns (a two-wire adapter?): set echo for its "
            "devices"};
  // A device that stood still may send several answers of one byte at once.
  const bool repeats = std::ranges::count(received, received.front()) == std::ssize(received);
  if (auto frame = own_frame(device, codec, repeats ? received.first(1) : received))
    return *std::move(frame);
  if (auto other = frame_of_another(device, received)) return *std::move(other);
  const bool is_text_line = is_on_line && codec.is_text();
  if (is_text_line) {
    if (auto parity = parity_in_bit_7(received)) return *std::move(parity);
    if (auto parity = zeros_among_text(received)) return *std::move(parity);
  }
  if (is_on_line)
    if (auto speed = bits_in_groups(received)) return *std::move(speed);
  if (auto other = beginning_of_another(device, received)) return *std::move(other);
  if (is_text_line)
    if (auto speed = no_text(received)) return *std::move(speed);
  return unknown;
}

std::string first_bytes(ByteView received, std::size_t most_kept) {
  std::string text = to_hex(received.first(std::min(received.size(), kShown)));
  if (received.size() > kShown)
    text += " … (" + std::to_string(received.size()) +
            (received.size() < most_kept ? " bytes)" : " or more bytes)");
  return text;
}

}  // namespace fxagent
