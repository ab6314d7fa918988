#include "protocol/mc/message.h"

#include <algorithm>
#include <iterator>
#include <string_view>
#include <utility>

#include "protocol/mc/body.h"
#include "protocol/mc/random_access.h"
#include "protocol/scatter.h"

namespace fxagent::mc {
namespace {

// Command names as in SH-080008.
constexpr std::pair<std::uint16_t, std::string_view> kCommandNames[] = {
    {0x0101, "read type name"},
    {0x0401, "batch read"},
    {0x0403, "random read"},
    {0x0406, "block read"},
    {0x0613, "buffer memory read"},
    {0x0619, "loopback test"},
    {0x0801, "register monitor data"},
    {0x0802, "monitor"},
    {0x1001, "remote RUN"},
    {0x1002, "remote STOP"},
    {0x1003, "remote PAUSE"},
    {0x1005, "remote latch clear"},
    {0x1006, "remote RESET"},
    {0x1401, "batch write"},
    {0x1402, "random write"},
    {0x1406, "block write"},
    {0x1617, "clear error"},
    {0x1630, "remote password unlock"},
    {0x1631, "remote password lock"},
};

constexpr std::uint32_t kWords = 0;  // subcommands
constexpr std::uint32_t kBits = 1;
constexpr std::size_t kModelCode = 2;

/// Returns the random read for a read of 32-bit devices, one part for each device; or, for a part
/// of a Gather, a Gather with only this part.
Gather parts_of(const Read& read, const ReadWay& by) {
  if (by.gather != 0) return {{{read.span, read.way, by.gather}}};
  const std::uint32_t unit_bits = by.unit_bits;
  Gather gather;
  const auto way = static_cast<std::uint8_t>(kRandomWay | (read.way & kPlainCodes));
  for (std::uint32_t done = 0; done < read.span.bits; done += unit_bits)
    gather.parts.push_back(
        {{read.span.space, read.span.first_bit + done, unit_bits}, way, kRandomRead});
  return gather;
}

Result<Bytes> encode_read(const Dialect& dialect, const Read& read) {
  const auto way = way_of(dialect, read);
  if (!way) return tl::make_unexpected(way.error());
  if (way->gather != 0 || way->way == kDwordWay)
    return encode_gather(dialect, parts_of(read, *way));
  Body body(dialect, has_long_codes(dialect, read.way), id(Command::read),
            way->way == kBitWay ? kBits : kWords);
  if (const auto named = body.device(read.span.space, read.span.first_bit); !named)
    return tl::make_unexpected(named.error());
  body.number(read.span.bits / way->unit_bits, 2);
  return body.take();
}

Result<Bytes> encode_write(const Dialect& dialect, const Write& write) {
  const Span& span = write.span;
  if (const auto allowed = check_write(dialect.model, span); !allowed)
    return tl::make_unexpected(allowed.error());
  const bool long_codes = has_long_codes(dialect, write.way);
  const std::uint32_t width = width_of(span.space);
  if (write.image.size() != (span.bits + 7) / 8)
    return refuse("write of " + std::to_string(span.bits) + " bits with " +
                  std::to_string(write.image.size()) + " bytes to " +
                  device_name(dialect.model, span));
  if (width == 32) return encode_scatter(dialect, {{write}});
  const Limits limits = limits_of(dialect, long_codes);
  const bool by_bits =
      width == 1 && (span.bits % 16 != 0 || is_contact(static_cast<Space>(span.space)));
  const std::uint32_t unit = by_bits ? 1 : 16;
  const std::uint32_t points = span.bits / unit;
  const std::uint32_t most = by_bits ? limits.bits : limits.words;
  if (points > most)
    return refuse("write of " + std::to_string(points) + " points to " +
                  device_name(dialect.model, span) + ": at most " + std::to_string(most));
  Body body(dialect, long_codes, id(Command::write), by_bits ? kBits : kWords);
  if (const auto named = body.device(span.space, span.first_bit); !named)
    return tl::make_unexpected(named.error());
  body.number(points, 2);
  if (by_bits)
    append_bits(dialect.code, body.bytes(), write.image, span.bits);
  else
    append_image(dialect.code, body.bytes(), write.image, 2);
  return body.take();
}

Result<Bytes> encode_control(const Dialect& dialect, Control::Kind kind) {
  switch (kind) {
    case Control::Kind::identify:
      return Body(dialect, false, id(Command::type_name), 0).take();
    case Control::Kind::run: {
      Body body(dialect, false, id(Command::remote_run), 0);
      body.number(1, 2);  // not forced: fails if another station has stopped the PLC
      body.number(0, 1);  // clear no device
      body.number(0, 1);
      return body.take();
    }
    case Control::Kind::stop: {
      Body body(dialect, false, id(Command::remote_stop), 0);
      body.number(1, 2);
      return body.take();
    }
    case Control::Kind::reset:
      break;
  }
  return fail(ErrorCode::unsupported, "the MC protocol has no reset of the line");
}

std::size_t read_size(Code code, const Read& read) {
  if (plain_way(read.way) != kBitWay) return wire_size(code, read.span.bits / 8);
  return code == Code::ascii ? read.span.bits : (read.span.bits + 1) / 2;
}

std::optional<Request> scattered(const Dialect& dialect, const std::vector<Request>& requests) {
  auto scatter = scatter_of(requests);
  if (!scatter || !encode_scatter(dialect, *scatter)) return std::nullopt;
  return Request(std::move(*scatter));
}

}  // namespace

std::string_view command_name(std::uint16_t command) {
  const auto* const found = std::find_if(std::begin(kCommandNames), std::end(kCommandNames),
                                         [&](const auto& one) { return one.first == command; });
  return found == std::end(kCommandNames) ? std::string_view{} : found->second;
}

Result<Bytes> encode_message(const Dialect& dialect, const Request& request) {
  if (const auto* read = std::get_if<Read>(&request)) return encode_read(dialect, *read);
  if (const auto* write = std::get_if<Write>(&request)) return encode_write(dialect, *write);
  if (const auto* gather = std::get_if<Gather>(&request)) return encode_gather(dialect, *gather);
  if (const auto* scatter = std::get_if<Scatter>(&request))
    return encode_scatter(dialect, *scatter);
  if (const auto* force = std::get_if<Force>(&request)) {
    if (force->space < kSpaces && width_of(force->space) != 1)
      return refuse(device_name(dialect.model, {force->space, force->bit, 1}) +
                    " is a word: only bits can be forced");
    return encode_write(dialect, write_of(*force));
  }
  if (const auto* control = std::get_if<Control>(&request))
    return encode_control(dialect, control->kind);
  return fail(ErrorCode::unsupported, "the MC protocol has no enquiry of its own");
}

std::size_t answer_size(const Dialect& dialect, const Request& request) {
  if (const auto* read = std::get_if<Read>(&request)) return read_size(dialect.code, *read);
  if (const auto* gather = std::get_if<Gather>(&request)) return gather_size(dialect, *gather);
  const auto* control = std::get_if<Control>(&request);
  if (control == nullptr || control->kind != Control::Kind::identify) return 0;
  return kTypeName + wire_size(dialect.code, kModelCode);  // the name is text in binary code, too
}

Result<Bytes> decode_answer(const Dialect& dialect, const Request& request, ByteView data) {
  if (const auto* read = std::get_if<Read>(&request)) {
    if (plain_way(read->way) == kBitWay) return bits_in(dialect.code, data, read->span.bits);
    const auto space = static_cast<Space>(read->span.space);
    const bool pairs = plain_way(read->way) == kRandomWay && read->span.bits == 32;
    return image_in(dialect.code, data, pairs || kind_of(space).bits == 32 ? 4 : 2);
  }
  if (const auto* gather = std::get_if<Gather>(&request))
    return decode_gather(dialect, *gather, data);
  if (data.empty()) return Bytes{};
  Bytes image(data.begin(), data.begin() + kTypeName);
  auto code = image_in(dialect.code, data.subspan(kTypeName), kModelCode);
  if (!code) return code;
  image.insert(image.end(), code->begin(), code->end());
  return image;
}

std::optional<Request> combined(const Dialect& dialect, const std::vector<Request>& requests) {
  if (requests.size() < 2) return std::nullopt;
  if (!std::holds_alternative<Read>(requests.front())) return scattered(dialect, requests);
  std::vector<Read> reads;
  for (const Request& request : requests) {
    const auto* read = std::get_if<Read>(&request);
    if (read == nullptr) return std::nullopt;
    reads.push_back(*read);
  }
  auto gather = gathered(dialect, reads);
  return gather ? std::optional<Request>(std::move(*gather)) : std::nullopt;
}

}  // namespace fxagent::mc
