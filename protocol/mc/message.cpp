#include "protocol/mc/message.h"

#include <algorithm>
#include <utility>

#include "protocol/encoding.h"
#include "protocol/mc/body.h"

namespace fxagent::mc {
namespace {

constexpr std::uint32_t kWords = 0;  // subcommands
constexpr std::uint32_t kBits = 1;
constexpr std::size_t kModelCode = 2;

// ---- scattered places: 0403 (random read), 0406 (blocks), 1402 (random write) -----------------

tl::unexpected<Error> cannot() {
  return fail(ErrorCode::unsupported, "these places do not fit in one frame");
}

std::uint32_t words_of(const Read& part) { return part.span.bits / 16; }

bool is_block_read(const Gather& gather) {
  return !gather.parts.empty() && gather.parts.front().gather == kBlockRead;
}

/// True in the second half of a frame: words come before double words, and blocks of words before
/// blocks of bits.
bool is_later(const Read& part) {
  return part.gather == kBlockRead ? width_of(part.span.space) == 1 : words_of(part) == 2;
}

/// Returns the indices of all parts in the order of the frame.
std::vector<std::size_t> frame_order(const Gather& gather) {
  std::vector<std::size_t> order;
  for (const bool later : {false, true})
    for (std::size_t i = 0; i < gather.parts.size(); ++i)
      if (is_later(gather.parts[i]) == later) order.push_back(i);
  return order;
}

Result<void> check_gather(const Dialect& dialect, const Gather& gather) {
  if (gather.parts.empty()) return refuse("a read of nothing");
  std::uint32_t bits = 0;
  for (const Read& part : gather.parts) {
    const auto way = way_of(dialect, part);
    if (!way) return fail(way);
    if (part.gather == 0 || part.gather != way->gather ||
        part.gather != gather.parts.front().gather)
      return refuse("these places do not fit in one frame");
    bits += part.span.bits;
  }
  for (const GatherCommand& command : gathers(dialect))
    if (command.gather == gather.parts.front().gather && gather.parts.size() <= command.max_parts &&
        bits <= command.max_bits)
      return {};
  return refuse(std::to_string(gather.parts.size()) + " places do not fit in one frame");
}

/// Splits the words of a part into double words and, at the end, a single word.
void cut(const Write& part, std::vector<Write>& words, std::vector<Write>& dwords) {
  for (std::uint32_t done = 0; done < part.span.bits;) {
    const bool pair = part.span.bits - done >= 32;
    const std::uint32_t bits = pair ? 32 : 16;
    (pair ? dwords : words)
        .push_back({{part.span.space, part.span.first_bit + done, bits},
                    extract_bits(part.image, done, bits)});
    done += bits;
  }
}

Result<Bytes> encode_bits(const Dialect& dialect, const Scatter& scatter, bool long_codes,
                          std::uint32_t bits) {
  Body body(dialect, long_codes, id(Command::random_write), kBits);
  body.number(bits, 1);
  for (const Write& part : scatter.parts)
    for (std::uint32_t i = 0; i < part.span.bits; ++i) {
      body.device(part.span.space, part.span.first_bit + i);
      body.number(part.image[i / 8] >> (i % 8) & 1U, long_codes ? 2 : 1);
    }
  return body.take();
}

/// Encodes a Gather by 0403 or 0406, according to its parts. Error: bad_request if it exceeds the
/// limits or mixes parts of both.
Result<Bytes> encode_gather(const Dialect& dialect, const Gather& gather) {
  if (const auto checked = check_gather(dialect, gather); !checked) return fail(checked);
  const bool blocks = is_block_read(gather);
  Body body(dialect, has_long_codes(dialect, gather.parts.front().way),
            id(blocks ? Command::block_read : Command::random_read), kWords);
  const auto later = static_cast<std::uint32_t>(std::ranges::count_if(gather.parts, is_later));
  body.number(static_cast<std::uint32_t>(gather.parts.size()) - later, 1);
  body.number(later, 1);
  for (const std::size_t i : frame_order(gather)) {
    const Read& part = gather.parts[i];
    body.device(part.span.space, part.span.first_bit);
    if (blocks) body.number(words_of(part), 2);
  }
  return body.take();
}

std::size_t gather_size(const Dialect& dialect, const Gather& gather) {
  std::size_t words = 0;
  for (const Read& part : gather.parts) words += words_of(part);
  return wire_size(dialect.code, 2 * words);
}

/// Returns the image of a Gather reply (request.h), part after part.
Result<Bytes> decode_gather(const Dialect& dialect, const Gather& gather, ByteView data) {
  std::vector<Bytes> images(gather.parts.size());
  std::size_t at = 0;
  const bool blocks = is_block_read(gather);
  for (const std::size_t i : frame_order(gather)) {
    const std::size_t words = words_of(gather.parts[i]);
    const std::size_t size = wire_size(dialect.code, 2 * words);
    // A double word has its high digits first. Its low word is in the first device.
    auto image = image_in(dialect.code, data.subspan(at, size), blocks ? 2 : 2 * words);
    if (!image) return image;
    at += size;
    images[i] = std::move(*image);
  }
  Bytes image;
  for (const Bytes& part : images) image.insert(image.end(), part.begin(), part.end());
  return image;
}

/// Encodes a Scatter by 1402: only bits, or words and double words. Error: unsupported if no frame
/// can carry these writes.
Result<Bytes> encode_scatter(const Dialect& dialect, const Scatter& scatter) {
  std::uint8_t flags = 0;
  bool all_bits = !scatter.parts.empty();
  bool all_words = all_bits;
  std::uint64_t bits = 0;
  for (const Write& part : scatter.parts) {
    if (const auto allowed = check_write(dialect.model, part.span); !allowed) return fail(allowed);
    if (const auto why = why_wrong_image(part); !why.empty())
      return refuse(device_name(dialect.model, part.span) + ": " + why);
    flags |= part.way;
    bits += part.span.bits;
    all_bits &= width_of(part.span.space) == 1;
    all_words &= is_words(part.span, 1);
  }
  const bool long_codes = has_long_codes(dialect, flags);
  const Limits limits = limits_of(dialect, long_codes);
  if (all_bits && bits <= limits.random_bits)
    return encode_bits(dialect, scatter, long_codes, static_cast<std::uint32_t>(bits));
  if (!all_words || bits / 32 * kDwordCost > limits.random_cost) return cannot();
  std::vector<Write> words;
  std::vector<Write> dwords;
  for (const Write& part : scatter.parts) cut(part, words, dwords);
  if (words.size() * kWordCost + dwords.size() * kDwordCost > limits.random_cost) return cannot();
  Body body(dialect, long_codes, id(Command::random_write), kWords);
  body.number(static_cast<std::uint32_t>(words.size()), 1);
  body.number(static_cast<std::uint32_t>(dwords.size()), 1);
  for (const std::vector<Write>* values : {&words, &dwords})
    for (const Write& value : *values) {
      body.device(value.span.space, value.span.first_bit);
      append_image(dialect.code, body.bytes(), value.image, value.image.size());
    }
  return body.take();
}

// ---- single places ------------------------------------------------------------------------------

/// Returns the random read for a read of 32-bit devices, one part for each device; or, for a part
/// of a Gather, a Gather with only this part.
Gather parts_of(const Read& read, const ReadWay& by) {
  if (by.gather != 0) return {{{read.span, read.way, by.gather}}};
  const std::uint32_t unit_bits = by.unit_bits;
  Gather gather;
  for (std::uint32_t done = 0; done < read.span.bits; done += unit_bits)
    gather.parts.push_back(
        {{read.span.space, read.span.first_bit + done, unit_bits}, kRandomWay, kRandomRead});
  return gather;
}

Result<Bytes> encode_read(const Dialect& dialect, const Read& read) {
  const auto way = way_of(dialect, read);
  if (!way) return fail(way);
  if (way->gather != 0 || way->way == kDwordWay)
    return encode_gather(dialect, parts_of(read, *way));
  Body body(dialect, has_long_codes(dialect, read.way), id(Command::read),
            way->way == kBitWay ? kBits : kWords);
  body.device(read.span.space, read.span.first_bit);
  body.number(read.span.bits / way->unit_bits, 2);
  return body.take();
}

Result<Bytes> encode_write(const Dialect& dialect, const Write& write) {
  const Span& span = write.span;
  if (const auto allowed = check_write(dialect.model, span); !allowed) return fail(allowed);
  const bool long_codes = has_long_codes(dialect, write.way);
  const std::uint32_t width = width_of(span.space);
  if (const auto why = why_wrong_image(write); !why.empty())
    return refuse(device_name(dialect.model, span) + ": " + why);
  if (width == 32) return encode_scatter(dialect, {{write}});
  const Limits limits = limits_of(dialect, long_codes);
  const bool by_bits = !is_words(span, 1);
  const std::uint32_t unit = by_bits ? 1 : 16;
  const std::uint32_t points = span.bits / unit;
  const std::uint32_t most = by_bits ? limits.bits : limits.words;
  if (points > most)
    return refuse("write of " + std::to_string(points) + " points to " +
                  device_name(dialect.model, span) + ": at most " + std::to_string(most));
  Body body(dialect, long_codes, id(Command::write), by_bits ? kBits : kWords);
  body.device(span.space, span.first_bit);
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
  if (read.way != kBitWay) return wire_size(code, read.span.bits / 8);
  return code == Code::ascii ? read.span.bits : (read.span.bits + 1) / 2;
}

}  // namespace

Result<Bytes> encode_message(const Dialect& dialect, const Request& request) {
  if (const auto* read = std::get_if<Read>(&request)) return encode_read(dialect, *read);
  if (const auto* write = std::get_if<Write>(&request)) return encode_write(dialect, *write);
  if (const auto* gather = std::get_if<Gather>(&request)) return encode_gather(dialect, *gather);
  if (const auto* scatter = std::get_if<Scatter>(&request))
    return encode_scatter(dialect, *scatter);
  if (const auto* force = std::get_if<Force>(&request))
    return encode_write(dialect, write_of(*force));
  if (const auto* control = std::get_if<Control>(&request))
    return encode_control(dialect, control->kind);
  return fail(ErrorCode::unsupported, "the MC protocol has no enquiry of its own");
}

std::size_t answer_size(const Dialect& dialect, const Request& request) {
  if (const auto* read = std::get_if<Read>(&request)) return read_size(dialect.code, *read);
  if (const auto* gather = std::get_if<Gather>(&request)) return gather_size(dialect, *gather);
  if (!is_identify(request)) return 0;
  return kTypeName + wire_size(dialect.code, kModelCode);  // the name is text in binary code, too
}

Result<Bytes> decode_answer(const Dialect& dialect, const Request& request, ByteView data) {
  if (const auto* read = std::get_if<Read>(&request)) {
    if (read->way == kBitWay) return bits_in(dialect.code, data, read->span.bits);
    const auto space = static_cast<Space>(read->span.space);
    const bool pairs = read->way == kRandomWay && read->span.bits == 32;
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

}  // namespace fxagent::mc
