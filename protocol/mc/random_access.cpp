#include "protocol/mc/random_access.h"

#include <algorithm>

#include "protocol/mc/body.h"
#include "protocol/mc/message.h"

namespace fxagent::mc {
namespace {

constexpr std::uint32_t kWordCost = 12;  // SH-080008: 12 for a word and 14 for a double word
constexpr std::uint32_t kDwordCost = 14;
constexpr std::uint32_t kBlockPoints = 960;

tl::unexpected<Error> cannot() {
  return fail(ErrorCode::unsupported, "no frame carries these places together");
}

/// The whole words that hold one part of a Gather.
struct Cover {
  std::uint16_t space = 0;
  std::uint32_t first_bit = 0;
  std::uint32_t words = 0;
  std::uint32_t width = 16;  ///< bits of one device
  std::uint32_t skip = 0;    ///< bits of the cover before the part's own

  std::uint32_t dwords() const { return words / 2; }
  std::uint32_t odd() const { return words % 2; }
};

std::optional<Cover> cover_of(const Dialect& dialect, const Read& read) {
  const Span& span = read.span;
  if (span.space >= kSpaces || span.bits == 0 || !check_range(dialect.model, span))
    return std::nullopt;
  const auto space = static_cast<Space>(span.space);
  Cover cover{span.space, span.first_bit, (span.bits + 15) / 16, kind_of(space).bits, 0};
  if (is_contact(space)) return std::nullopt;
  if (cover.width != 1) {
    if (span.first_bit % cover.width != 0 || span.bits % cover.width != 0) return std::nullopt;
    return cover;
  }
  // The last word of a bit device must not stick out behind the last one.
  const std::uint32_t end = span_of(space, *numbers_of(dialect.model, space)).end_bit();
  const std::uint32_t bits = cover.words * 16;
  if (bits > end) return std::nullopt;
  cover.first_bit = std::min(span.first_bit, end - bits);
  cover.skip = span.first_bit - cover.first_bit;
  return cover;
}

/// How a Gather is sent.
struct Plan {
  std::vector<Cover> covers;
  bool long_codes = false;
  bool blocks = false;
  std::uint32_t words = 0;  ///< 0403: single words and double words
  std::uint32_t dwords = 0;
  std::uint32_t total = 0;  ///< words of all answers
};

std::optional<Plan> plan_of(const Dialect& dialect, const Gather& gather) {
  if (gather.parts.empty()) return std::nullopt;
  Plan plan;
  std::uint8_t flags = 0;
  bool only_random = false;
  for (const Read& part : gather.parts) {
    const auto cover = cover_of(dialect, part);
    if (!cover) return std::nullopt;
    plan.covers.push_back(*cover);
    plan.words += cover->odd();
    plan.dwords += cover->dwords();
    plan.total += cover->words;
    only_random |= cover->width == 32;
    flags |= part.way;
  }
  plan.long_codes = has_long_codes(dialect, flags);
  const Limits limits = limits_of(dialect, plan.long_codes);
  if (plan.total * 2 > std::max(dialect.max_block_bytes, limits.random * 4)) return std::nullopt;
  const std::size_t device = device_size(dialect.code, plan.long_codes);
  const std::size_t points = wire_size(dialect.code, 2);
  const std::size_t by_random = (plan.words + plan.dwords) * device;
  const std::size_t by_blocks = plan.covers.size() * (device + points);
  const bool random_fits = plan.words + plan.dwords <= limits.random;
  const bool blocks_fit = !only_random && (flags & kNoBlocks) == 0 &&
                          plan.covers.size() <= limits.blocks &&
                          plan.total <= std::min(kBlockPoints, limits.words);
  if (!random_fits && !blocks_fit) return std::nullopt;
  plan.blocks = blocks_fit && (!random_fits || by_blocks < by_random);
  return plan;
}

/// Calls `visit(cover, first word, words)` for every access of a random read in the sequence of the
/// frame: first single words, then double words.
template <class Visit>
void for_each_access(const Plan& plan, Visit visit) {
  for (std::size_t i = 0; i < plan.covers.size(); ++i)
    if (plan.covers[i].odd() != 0) visit(i, plan.covers[i].words - 1, 1U);
  for (std::size_t i = 0; i < plan.covers.size(); ++i)
    for (std::uint32_t n = 0; n < plan.covers[i].dwords(); ++n) visit(i, 2 * n, 2U);
}

/// The same for blocks: those of words, then those of bits.
template <class Visit>
void for_each_block(const Plan& plan, Visit visit) {
  for (const bool bits : {false, true})
    for (std::size_t i = 0; i < plan.covers.size(); ++i)
      if ((plan.covers[i].width == 1) == bits) visit(i, 0U, plan.covers[i].words);
}

/// One value of a random write.
struct Item {
  std::uint16_t space = 0;
  std::uint32_t bit = 0;
  Bytes image;
};

/// Cuts the words of a part into double words and, at the end, a single one.
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
  const auto plan = plan_of(dialect, gather);
  if (!plan) return cannot();
  Body body(dialect, plan->long_codes,
            id(plan->blocks ? Command::block_read : Command::random_read), 0);
  Result<void> named;
  const auto name = [&](std::size_t part, std::uint32_t word) {
    const Cover& cover = plan->covers[part];
    if (named) named = body.device(cover.space, cover.first_bit + word * 16);
  };
  if (plan->blocks) {
    const auto bit_blocks = std::count_if(plan->covers.begin(), plan->covers.end(),
                                          [](const Cover& cover) { return cover.width == 1; });
    const auto of_bits = static_cast<std::uint32_t>(bit_blocks);
    body.number(static_cast<std::uint32_t>(plan->covers.size()) - of_bits, 1);
    body.number(of_bits, 1);
    for_each_block(*plan, [&](std::size_t part, std::uint32_t word, std::uint32_t words) {
      name(part, word);
      body.number(words, 2);
    });
  } else {
    body.number(plan->words, 1);
    body.number(plan->dwords, 1);
    for_each_access(*plan,
                    [&](std::size_t part, std::uint32_t word, std::uint32_t) { name(part, word); });
  }
  if (!named) return tl::make_unexpected(named.error());
  return body.take();
}

bool goes_by_blocks(const Dialect& dialect, const Gather& gather) {
  const auto plan = plan_of(dialect, gather);
  return plan && plan->blocks;
}

std::size_t gather_size(const Dialect& dialect, const Gather& gather) {
  std::size_t words = 0;
  for (const Read& part : gather.parts) words += (part.span.bits + 15) / 16;
  return wire_size(dialect.code, 2 * words);
}

Result<Bytes> decode_gather(const Dialect& dialect, const Gather& gather, ByteView data) {
  const auto plan = plan_of(dialect, gather);
  if (!plan) return cannot();
  std::vector<Bytes> covers;
  for (const Cover& cover : plan->covers) covers.emplace_back(2 * cover.words);
  std::size_t at = 0;
  std::optional<Error> error;
  const auto take = [&](std::size_t part, std::uint32_t word, std::uint32_t words) {
    const std::size_t size = wire_size(dialect.code, 2 * std::size_t{words});
    // A double word has its high digits first, and its low word in the first device.
    const auto image = image_in(dialect.code, data.subspan(at, size), plan->blocks ? 2 : 2 * words);
    at += size;
    if (!image)
      error = image.error();
    else
      std::copy(image->begin(), image->end(),
                covers[part].begin() + static_cast<std::ptrdiff_t>(2 * word));
  };
  if (plan->blocks)
    for_each_block(*plan, take);
  else
    for_each_access(*plan, take);
  if (error) return tl::make_unexpected(*error);
  Bytes image;
  for (std::size_t i = 0; i < covers.size(); ++i) {
    const Bytes part = extract_bits(covers[i], plan->covers[i].skip, gather.parts[i].span.bits);
    image.insert(image.end(), part.begin(), part.end());
  }
  return image;
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
    all_bits &= kind_of(static_cast<Space>(part.span.space)).bits == 1;
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

Write write_of(const Force& force) {
  return {{force.space, force.bit, 1}, {static_cast<std::uint8_t>(force.on ? 1 : 0)}, force.way};
}

}  // namespace fxagent::mc
