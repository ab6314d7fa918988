#include "protocol/encoding.h"

#include <algorithm>
#include <utility>

namespace fxagent {

std::optional<std::uint32_t> number_in(NumberForm form, ByteView wire) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < wire.size(); ++i) {
    const std::uint8_t byte = wire[form == NumberForm::low_first ? wire.size() - 1 - i : i];
    const int part = form == NumberForm::digits ? hex_digit(byte) : byte;
    if (part < 0) return std::nullopt;
    value = value << (form == NumberForm::digits ? 4 : 8) | static_cast<std::uint32_t>(part);
  }
  return value;
}

bool is_hex(ByteView wire) {
  return std::ranges::all_of(wire, [](std::uint8_t c) { return hex_digit(c) >= 0; });
}

Result<Bytes> bytes_in(ByteView digits) {
  Bytes bytes;
  bytes.reserve(digits.size() / 2);
  for (std::size_t at = 0; at + 2 <= digits.size(); at += 2) {
    const ByteView pair = digits.subspan(at, 2);
    const int byte = hex_byte(pair);
    if (byte < 0) return garbled("data " + to_hex(pair) + " is not two hex digits");
    bytes.push_back(static_cast<std::uint8_t>(byte));
  }
  return bytes;
}

std::string why_wrong_sum(ByteView given, ByteView bytes) {
  const int sum = hex_byte(given);
  if (sum < 0) return "sum " + to_hex(given) + " is not two hex digits";
  const std::uint8_t computed = byte_sum(bytes);
  if (sum == computed) return {};
  return "sum " + as_text(given) + " given, " + hex_text(computed, 2) + " computed";
}

std::string why_wrong_image(const Write& write, std::uint32_t most) {
  const std::uint32_t bits = write.span.bits;
  const std::size_t bytes = write.image.size();
  if (bits <= most && bytes == (std::size_t{bits} + 7) / 8) return {};
  return "write of " + std::to_string(bits) + " bits with " + std::to_string(bytes) + " bytes" +
         (most == 0xFFFFFFFF ? std::string() : ", at most " + std::to_string(most) + " bits");
}

Write write_of(const Force& force) {
  return {{force.space, force.bit, 1}, {static_cast<std::uint8_t>(force.on ? 1 : 0)}, force.way};
}

Result<ReadWay> way_for(const std::vector<ReadWay>& ways, std::uint8_t number, const Span& span,
                        const std::function<std::string()>& name, std::string_view how) {
  for (const ReadWay& way : ways) {
    if (way.way != number || span.first_bit < way.first_bit || span.bits > way.end_bit ||
        span.first_bit > way.end_bit - span.bits)
      continue;
    if (span.first_bit % way.align_bits == 0 && span.bits % way.unit_bits == 0 && span.bits != 0 &&
        span.bits <= way.max_bits)
      return way;
    return refuse("read of " + std::to_string(span.bits) + " bits from " + name() + ": at most " +
                  std::to_string(way.max_bits) + ", in steps of " + std::to_string(way.unit_bits));
  }
  return fail(ErrorCode::unsupported, name() + ": " + std::to_string(span.bits) +
                                          " bits cannot be " + std::string(how) + " on this model");
}

std::optional<Request> Codec::shorter_read(const Request& request) const {
  const auto* gather = std::get_if<Gather>(&request);
  if (gather != nullptr && gather->parts.size() > 1) return Gather{{gather->parts.front()}};
  const auto* read = std::get_if<Read>(&request);
  const std::uint32_t less = read == nullptr ? 0 : shorter_by(*read);
  if (less == 0 || read->span.bits <= less) return std::nullopt;
  Read shorter = *read;
  shorter.span.bits -= less;
  return shorter;
}

std::optional<Request> Codec::combine(const std::vector<Request>& requests) const {
  if (requests.size() < 2) return std::nullopt;
  Scatter scatter;
  for (const Request& request : requests) {
    if (const auto* write = std::get_if<Write>(&request))
      scatter.parts.push_back(*write);
    else if (const auto* force = std::get_if<Force>(&request))
      scatter.parts.push_back(write_of(*force));
    else
      return std::nullopt;
  }
  if (!encode(scatter, 0)) return std::nullopt;
  return Request(std::move(scatter));
}

}  // namespace fxagent
