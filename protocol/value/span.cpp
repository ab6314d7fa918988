#include "protocol/value/span.h"

#include <algorithm>
#include <utility>

namespace fxagent {

bool is_covered(Span span, std::span<const Span> ranges) {
  while (span.bits > 0) {
    const auto range = std::ranges::find_if(ranges, [&span](const Span& each) {
      return each.contains({span.space, span.first_bit, 1});
    });
    if (range == ranges.end()) return false;
    const std::uint32_t end = std::min(range->end_bit(), span.end_bit());
    span = {span.space, end, span.end_bit() - end};
  }
  return true;
}

std::vector<Span> merged(std::vector<Span> spans) {
  std::ranges::sort(spans, {},
                    [](const Span& span) { return std::pair(span.space, span.first_bit); });
  std::vector<Span> runs;
  for (const Span& span : spans) {
    if (runs.empty() || runs.back().space != span.space || runs.back().end_bit() < span.first_bit)
      runs.push_back(span);
    else
      runs.back().bits = std::max(runs.back().end_bit(), span.end_bit()) - runs.back().first_bit;
  }
  return runs;
}

std::uint64_t bits_at(ByteView image, std::size_t from_bit, std::uint32_t bits) {
  std::uint64_t value = 0;
  for (std::uint32_t done = 0; done < bits;) {
    const std::size_t at = from_bit + done;
    const std::uint64_t byte = at / 8 < image.size() ? image[at / 8] : 0;
    value |= byte >> (at % 8) << done;
    done += static_cast<std::uint32_t>(8 - at % 8);
  }
  return value & ~std::uint64_t{0} >> (64 - bits);
}

Bytes extract_bits(ByteView image, std::uint32_t from_bit, std::uint32_t bits) {
  Bytes out((bits + 7) / 8, 0);
  for (std::uint32_t done = 0; done < bits; done += 8) {
    const std::uint32_t take = std::min<std::uint32_t>(8, bits - done);
    out[done / 8] = static_cast<std::uint8_t>(bits_at(image, std::size_t{from_bit} + done, take));
  }
  return out;
}

void insert_bits(Bytes& image, std::uint32_t to_bit, ByteView part, std::uint32_t bits) {
  for (std::uint32_t done = 0; done < bits; done += 8) {
    const std::uint32_t take = std::min<std::uint32_t>(8, bits - done);
    const std::size_t at = (std::size_t{to_bit} + done) / 8;
    const std::uint32_t shift = (to_bit + done) % 8;
    const std::uint32_t mask = ((1U << take) - 1) << shift;
    const auto value = static_cast<std::uint32_t>(bits_at(part, done, take)) << shift;
    image[at] = static_cast<std::uint8_t>((image[at] & ~mask) | value);
    if (mask > 0xFF)
      image[at + 1] = static_cast<std::uint8_t>((image[at + 1] & ~(mask >> 8)) | value >> 8);
  }
}

}  // namespace fxagent
