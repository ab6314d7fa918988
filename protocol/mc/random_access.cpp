#include "protocol/mc/random_access.h"

#include <algorithm>

#include "protocol/mc/body.h"
#include "protocol/mc/message.h"

namespace fxagent::mc {
namespace {

constexpr std::uint32_t kWordCost = 12;  // SH-080008: a word costs 12, a double word 14
constexpr std::uint32_t kDwordCost = 14;

tl::unexpected<Error> cannot() {
  return fail(ErrorCode::unsupported, "these places do not fit in one frame");
}

std::uint32_t words_of(const Read& part) { return part.span.bits / 16; }

bool is_block_read(const Gather& gather) {
  return !gather.parts.empty() && gather.parts.front().gather == kBlockRead;
}

bool is_of_bits(const Read& part) { return width_of(part.span.space) == 1; }

/// Calls `visit` with the index of every part in the order of the frame: words before double words,
/// and blocks of words before blocks of bits.
template <class Visit>
void for_each_part(const Gather& gather, Visit visit) {
  const bool blocks = is_block_read(gather);
  for (const bool later : {false, true})
    for (std::size_t i = 0; i < gather.parts.size(); ++i) {
      const Read& part = gather.parts[i];
      if ((blocks ? is_of_bits(part) : words_of(part) == 2) == later) visit(i);
    }
}

/// Returns the number of parts in the second half of that order.
std::uint32_t later_parts(const Gather& gather) {
  const bool blocks = is_block_read(gather);
  return static_cast<std::uint32_t>(std::count_if(
      gather.parts.begin(), gather.parts.end(),
      [&](const Read& part) { return blocks ? is_of_bits(part) : words_of(part) == 2; }));
}

Result<void> check_gather(const Dialect& dialect, const Gather& gather) {
  if (gather.parts.empty()) return fail(ErrorCode::bad_request, "a read of nothing");
  std::uint32_t bits = 0;
  for (const Read& part : gather.parts) {
    const auto way = way_of(dialect, part);
    if (!way) return tl::make_unexpected(way.error());
    if (part.gather == 0 || part.gather != way->gather ||
        part.gather != gather.parts.front().gather)
      return fail(ErrorCode::bad_request, "these places do not fit in one frame");
    bits += part.span.bits;
  }
  for (const GatherCommand& command : gathers(dialect))
    if (command.gather == gather.parts.front().gather && gather.parts.size() <= command.max_parts &&
        bits <= command.max_bits)
      return {};
  return fail(ErrorCode::bad_request,
              std::to_string(gather.parts.size()) + " places do not fit in one frame");
}

/// One value of a random write.
struct Item {
  std::uint16_t space = 0;
  std::uint32_t bit = 0;
  Bytes image;
};

/// Splits the words of a part into double words and, at the end, a single word.
void cut(const Write& part, std::vector<Item>& words, std::vector<Item>& dwords) {
  for (std::uint32_t done = 0; done < part.span.bits;) {
    const bool pair = part.span.bits - done >= 32;
    const std::uint32_t bits = pair ? 32 : 16;
    Item item{part.span.space, part.span.first_bit + done, extract_bits(part.image, done, bits)};
    (pair ? dwords : words).push_back(std::move(item));
    done += bits;
  }
}

bool is_whole_words(const Span& span) {
  const auto space = static_cast<Space>(span.space);
  return span.bits % 16 == 0 && !(kind_of(space).bits == 1 && is_contact(space));
}

Result<Bytes> encode_bits(const Dialect& dialect, const Scatter& scatter, bool long_codes,
                          std::uint32_t bits) {
  Body body(dialect, long_codes, id(Command::random_write), 1);
  body.number(bits, 1);
  for (const Write& part : scatter.parts) {
    for (std::uint32_t i = 0; i < part.span.bits; ++i) {
      if (const auto named = body.device(part.span.space, part.span.first_bit + i); !named)
        return tl::make_unexpected(named.error());
      body.number(part.image[i / 8] >> (i % 8) & 1U, long_codes ? 2 : 1);
    }
  }
  return body.take();
}

}  // namespace

Result<Bytes> encode_gather(const Dialect& dialect, const Gather& gather) {
  if (const auto checked = check_gather(dialect, gather); !checked)
    return tl::make_unexpected(checked.error());
  const bool blocks = is_block_read(gather);
  Body body(dialect, has_long_codes(dialect, gather.parts.front().way),
            id(blocks ? Command::block_read : Command::random_read), 0);
  const std::uint32_t later = later_parts(gather);
  body.number(static_cast<std::uint32_t>(gather.parts.size()) - later, 1);
  body.number(later, 1);
  Result<void> named;
  for_each_part(gather, [&](std::size_t i) {
    const Read& part = gather.parts[i];
    if (named) named = body.device(part.span.space, part.span.first_bit);
    if (blocks) body.number(words_of(part), 2);
  });
  if (!named) return tl::make_unexpected(named.error());
  return body.take();
}

std::size_t gather_size(const Dialect& dialect, const Gather& gather) {
  std::size_t words = 0;
  for (const Read& part : gather.parts) words += words_of(part);
  return wire_size(dialect.code, 2 * words);
}

Result<Bytes> decode_gather(const Dialect& dialect, const Gather& gather, ByteView data) {
  std::vector<Bytes> images(gather.parts.size());
  std::optional<Error> error;
  std::size_t at = 0;
  const bool blocks = is_block_read(gather);
  for_each_part(gather, [&](std::size_t i) {
    const std::size_t words = words_of(gather.parts[i]);
    const std::size_t size = wire_size(dialect.code, 2 * words);
    // A double word has its high digits first. Its low word is in the first device.
    auto image = image_in(dialect.code, data.subspan(at, size), blocks ? 2 : 2 * words);
    at += size;
    if (image)
      images[i] = std::move(*image);
    else
      error = image.error();
  });
  if (error) return tl::make_unexpected(*error);
  Bytes image;
  for (const Bytes& part : images) image.insert(image.end(), part.begin(), part.end());
  return image;
}

std::optional<Gather> gathered(const Dialect& dialect, const std::vector<Read>& reads) {
  for (const GatherCommand& command : gathers(dialect)) {
    Gather gather;
    for (Read part : reads) {
      part.way = command.gather == kRandomRead ? kRandomWay : kBlockWay;
      part.gather = command.gather;
      gather.parts.push_back(part);
    }
    if (encode_gather(dialect, gather)) return gather;
  }
  return std::nullopt;
}

Result<Bytes> encode_scatter(const Dialect& dialect, const Scatter& scatter) {
  std::uint8_t flags = 0;
  bool all_bits = !scatter.parts.empty();
  bool all_words = all_bits;
  std::uint64_t bits = 0;
  for (const Write& part : scatter.parts) {
    if (const auto allowed = check_write(dialect.model, part.span); !allowed)
      return tl::make_unexpected(allowed.error());
    if (part.image.size() != (part.span.bits + 7) / 8)
      return fail(ErrorCode::bad_request, device_name(dialect.model, part.span) + ": " +
                                              std::to_string(part.image.size()) + " bytes for " +
                                              std::to_string(part.span.bits) + " bits");
    flags |= part.way;
    bits += part.span.bits;
    all_bits &= width_of(part.span.space) == 1;
    all_words &= is_whole_words(part.span);
  }
  const bool long_codes = has_long_codes(dialect, flags);
  const Limits limits = limits_of(dialect, long_codes);
  if (all_bits && bits <= limits.random_bits)
    return encode_bits(dialect, scatter, long_codes, static_cast<std::uint32_t>(bits));
  if (!all_words || bits / 32 * kDwordCost > limits.random_cost) return cannot();
  std::vector<Item> words;
  std::vector<Item> dwords;
  for (const Write& part : scatter.parts) cut(part, words, dwords);
  if (words.size() * kWordCost + dwords.size() * kDwordCost > limits.random_cost) return cannot();
  Body body(dialect, long_codes, id(Command::random_write), 0);
  body.number(static_cast<std::uint32_t>(words.size()), 1);
  body.number(static_cast<std::uint32_t>(dwords.size()), 1);
  for (const std::vector<Item>* items : {&words, &dwords}) {
    for (const Item& item : *items) {
      if (const auto named = body.device(item.space, item.bit); !named)
        return tl::make_unexpected(named.error());
      append_image(dialect.code, body.bytes(), item.image, item.image.size());
    }
  }
  return body.take();
}

}  // namespace fxagent::mc
