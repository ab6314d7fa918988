#include "protocol/modbus/pdu.h"

#include <algorithm>
#include <array>
#include <initializer_list>
#include <variant>

#include "protocol/encoding.h"

namespace fxagent::modbus {
namespace {

/// Returns a function and numbers of two bytes, the high one first.
Bytes pdu_of(Function function, std::initializer_list<std::uint32_t> numbers) {
  Bytes pdu{code(function)};
  for (const std::uint32_t number : numbers)
    pdu.insert(pdu.end(),
               {static_cast<std::uint8_t>(number >> 8), static_cast<std::uint8_t>(number)});
  return pdu;
}

tl::unexpected<Error> cannot(std::string text) {
  return fail(ErrorCode::unsupported, std::move(text));
}

/// First number and count of a span of whole coils or registers.
struct Place {
  std::uint32_t number = 0;
  std::uint32_t count = 0;
};

Result<Place> place_of(const Span& span) {
  if (span.space > id(Space::holding_register)) return cannot("no such table");
  const std::uint32_t width = width_of(static_cast<Space>(span.space));
  if (span.bits == 0 || span.first_bit % width != 0 || span.bits % width != 0)
    return refuse("only whole registers can be read and written");
  const Place place{span.first_bit / width, span.bits / width};
  if (place.number >= kNumbers || place.count > kNumbers - place.number)
    return refuse("the numbers end at 65535");
  return place;
}

Function read_function(std::uint16_t space) {
  constexpr std::array kFunctions{Function::read_coils, Function::read_discrete_inputs,
                                  Function::read_input_registers, Function::read_holding_registers};
  return kFunctions[space];
}

bool is_bit_table(std::uint16_t space) { return width_of(static_cast<Space>(space)) == 1; }

/// Swaps the bytes of registers: images are low byte first, the wire is high byte first.
Bytes swapped(ByteView bytes) {
  Bytes out(bytes.begin(), bytes.end());
  for (std::size_t i = 0; i + 1 < out.size(); i += 2) std::swap(out[i], out[i + 1]);
  return out;
}

Result<Bytes> encode_read(const Read& read) {
  const auto place = place_of(read.span);
  if (!place) return fail(place);
  const std::uint32_t most = is_bit_table(read.span.space) ? kMaxReadBits : kMaxReadRegisters;
  if (read.way != 0 || place->count > most)
    return refuse("a read takes at most " + std::to_string(most));
  return pdu_of(read_function(read.span.space), {place->number, place->count});
}

Result<Bytes> encode_write(const Write& write) {
  const auto place = place_of(write.span);
  if (!place) return fail(place);
  const auto space = static_cast<Space>(write.span.space);
  if (space != Space::coil && space != Space::holding_register)
    return refuse(std::string(letters_of(space)) + " cannot be written");
  const std::uint32_t most = space == Space::coil ? kMaxWriteBits : kMaxWriteRegisters;
  if (place->count > most || write.image.size() != (write.span.bits + 7) / 8)
    return refuse("a write takes at most " + std::to_string(most) + ", and their image");
  if (space == Space::holding_register && place->count == 1 &&
      write.way == id(WriteWay::first_choice))
    return pdu_of(Function::write_register,
                  {place->number, write.image[0] | std::uint32_t{write.image[1]} << 8U});
  Bytes pdu = pdu_of(space == Space::coil ? Function::write_coils : Function::write_registers,
                     {place->number, place->count});
  pdu.push_back(static_cast<std::uint8_t>(write.image.size()));
  const Bytes data =
      space == Space::coil ? extract_bits(write.image, 0, write.span.bits) : swapped(write.image);
  pdu.insert(pdu.end(), data.begin(), data.end());
  return pdu;
}

Result<Bytes> encode_force(const Force& force) {
  if (force.space == id(Space::coil)) {
    if (force.way == id(WriteWay::several)) return encode_write(write_of(force));
    if (force.bit >= kNumbers) return refuse("the numbers end at 65535");
    return pdu_of(Function::write_coil, {force.bit, force.on ? 0xFF00U : 0U});
  }
  if (force.space != id(Space::holding_register)) return refuse("this bit cannot be written");
  if (force.way == id(WriteWay::read_modify_write))
    return cannot("a bit of a register is read, changed and written in two requests");
  const std::uint32_t number = force.bit / 16;
  if (number >= kNumbers) return refuse("the numbers end at 65535");
  const std::uint32_t mask = 1U << (force.bit % 16);
  const std::uint32_t and_mask = ~mask & 0xFFFF;  // bits that stay
  const std::uint32_t or_mask = force.on ? mask : 0;
  return pdu_of(Function::mask_write, {number, and_mask, or_mask});
}

// 6.21, device identification: MEI type 14, the basic objects (maker, product, version) from the
// first on. The answer repeats type and category, then has conformity, "more follows", the next
// object and the number of objects. Each object is its id, its length and its text.
constexpr std::array<std::uint8_t, 4> kIdentify{code(Function::device_identification), 0x0E, 1, 0};
constexpr std::size_t kIdentityHead = 7;
constexpr std::size_t kMoreFollows = 4;
constexpr std::size_t kLongestPdu = 253;

/// Returns the end of the object that begins at `at`; nullopt if its length is missing.
std::optional<std::size_t> end_of_object(ByteView pdu, std::size_t at) {
  if (at + 2 > pdu.size()) return std::nullopt;
  return at + 2 + pdu[at + 1];
}

std::optional<std::size_t> identity_length(ByteView pdu) {
  if (pdu.size() < kIdentityHead || pdu[1] != kIdentify[1]) return std::nullopt;
  std::size_t end = kIdentityHead;
  for (std::size_t left = pdu[kIdentityHead - 1]; left > 0; --left) {
    const auto next = end_of_object(pdu, end);
    if (!next || *next > kLongestPdu) return std::nullopt;
    end = *next;
  }
  return end;
}

Decoded decode_identity(ByteView pdu) {
  if (pdu.size() < kIdentityHead ||
      !std::equal(kIdentify.begin(), kIdentify.end() - 1, pdu.begin()))
    return std::nullopt;
  if (identity_length(pdu) != pdu.size()) return garbled("the objects do not fit the frame");
  Reply reply{.kind = Reply::Kind::data};
  for (std::size_t at = kIdentityHead; at < pdu.size();) {
    const std::size_t end = *end_of_object(pdu, at);
    if (!reply.image.empty()) reply.image.insert(reply.image.end(), {',', ' '});
    for (const std::uint8_t byte : pdu.subspan(at + 2, end - at - 2))
      reply.image.push_back(byte >= ' ' && byte <= '~' ? byte : std::uint8_t{'?'});
    at = end;
  }
  constexpr std::string_view kMore = ", and more";
  if (pdu[kMoreFollows] != 0) reply.image.insert(reply.image.end(), kMore.begin(), kMore.end());
  return reply;
}

Reply refusal(Function function, int device_code) {
  const std::string_view text = exception_coded(device_code).text;
  const bool lacks_mask_write = function == Function::mask_write && device_code == 1;
  return {.kind = Reply::Kind::nak,
          .device_code = device_code,
          .text = "exception " + hex_text(static_cast<std::uint32_t>(device_code), 2) + ": " +
                  (text.empty() ? "not in the specification" : std::string(text)) +
                  (lacks_mask_write ? "; with allow_read_modify_write the agent reads and writes "
                                      "the whole register"
                                    : "")};
}

}  // namespace

std::uint32_t width_of(Space space) {
  return space == Space::coil || space == Space::discrete_input ? 1 : 16;
}

std::string_view letters_of(Space space) {
  constexpr auto kLetters = std::to_array<std::string_view>({"co", "di", "ir", "hr"});
  return kLetters[id(space)];
}

Result<Bytes> encode_pdu(const Request& request) {
  if (const auto* read = std::get_if<Read>(&request)) return encode_read(*read);
  if (const auto* write = std::get_if<Write>(&request)) return encode_write(*write);
  if (const auto* force = std::get_if<Force>(&request)) return encode_force(*force);
  if (is_identify(request)) return Bytes(kIdentify.begin(), kIdentify.end());
  return cannot("Modbus has no such request");
}

std::size_t reply_length(const Request& request) {
  if (const auto* read = std::get_if<Read>(&request)) return 2 + (read->span.bits + 7) / 8;
  if (is_identify(request)) return kLongestPdu;
  const auto pdu = encode_pdu(request);
  if (pdu && pdu->front() == code(Function::mask_write)) return 7;
  return 5;
}

std::optional<std::size_t> answer_length(ByteView pdu) {
  if (pdu.size() < 2) return std::nullopt;
  if ((pdu[0] & kException) != 0) return 2;
  switch (static_cast<Function>(pdu[0])) {
    case Function::read_coils:
    case Function::read_discrete_inputs:
    case Function::read_holding_registers:
    case Function::read_input_registers:
    case Function::read_write:
      return 2 + std::size_t{pdu[1]};
    case Function::write_coil:
    case Function::write_register:
    case Function::write_coils:
    case Function::write_registers:
      return 5;
    case Function::mask_write:
      return 7;
    case Function::device_identification:
      return identity_length(pdu);
  }
  return std::nullopt;
}

Decoded decode_pdu(const Request& request, ByteView pdu) {
  const auto sent = encode_pdu(request);
  if (!sent) return fail(sent);
  if (pdu.empty()) return garbled("an answer without a function code");
  const std::uint8_t function = sent->front();
  if (pdu[0] == (function | kException)) {
    if (pdu.size() != 2) return garbled("an exception of " + std::to_string(pdu.size()) + " bytes");
    return refusal(Function{function}, pdu[1]);
  }
  if (pdu[0] != function) return std::nullopt;
  if (const auto* read = std::get_if<Read>(&request)) {
    const std::size_t bytes = (read->span.bits + 7) / 8;
    if (pdu.size() < 2 || pdu[1] != pdu.size() - 2)
      return garbled("the byte count does not fit the frame");
    if (pdu[1] != bytes) return std::nullopt;
    const ByteView data = pdu.subspan(2);
    return Reply{.kind = Reply::Kind::data,
                 .image = is_bit_table(read->span.space) ? extract_bits(data, 0, read->span.bits)
                                                         : swapped(data)};
  }
  if (is_identify(request)) return decode_identity(pdu);
  // The answer to a write repeats the beginning of its request: place, and value or quantity.
  const std::size_t length = reply_length(request);
  if (pdu.size() != length)
    return garbled("the answer to a write has " + std::to_string(pdu.size()) +
                   " bytes instead of " + std::to_string(length));
  if (!std::equal(pdu.begin(), pdu.end(), sent->begin())) return std::nullopt;
  return Reply{};
}

const Exception& exception_coded(int device_code) {
  using Meaning = RefusalMeaning;
  static constexpr Exception kExceptions[] = {
      {},
      {"illegal function", Meaning::final, Meaning::final},
      {"illegal data address", Meaning::hole, Meaning::final},
      {"illegal data value", Meaning::hole, Meaning::final},
      {"device failure"},
      {"acknowledged, but still in progress", Meaning::busy, Meaning::unclear},
      {"device busy", Meaning::busy, Meaning::busy},
      {"negative acknowledgement", Meaning::final, Meaning::final},
      {"memory parity error", Meaning::final, Meaning::final},
      {},
      {"the gateway has no path to the unit", Meaning::unreachable, Meaning::final},
      {"the unit behind the gateway does not answer", Meaning::unreachable, Meaning::unclear},
  };
  return kExceptions[device_code > 0 && device_code < std::ssize(kExceptions) ? device_code : 0];
}

}  // namespace fxagent::modbus
