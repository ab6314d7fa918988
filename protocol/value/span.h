// Runs of device memory and their images.
//
// A codec maps its device names to *spaces*. A space is a run of device memory of one kind (D, M,
// CN200-CN255, holding registers …), counted in bits from its first device. Whatever the wire
// format, a codec returns the content of a space as an *image*: bit n of the span is bit n % 8 of
// byte n / 8, and a 16-bit word lies low byte first. So one planner, one packer and one allow list
// serve every protocol.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "protocol/value/bytes.h"

namespace fxagent {

/// A run of bits in one space of a codec.
struct Span {
  std::uint16_t space = 0;
  std::uint32_t first_bit = 0;
  std::uint32_t bits = 0;

  std::uint32_t end_bit() const { return first_bit + bits; }
  bool contains(const Span& other) const {
    return space == other.space && first_bit <= other.first_bit && other.end_bit() <= end_bit();
  }
  friend bool operator==(const Span&, const Span&) = default;
};

/// True if every bit of `span` lies in one of the ranges.
bool is_covered(Span span, std::span<const Span> ranges);

/// True if the two spans have a bit in common.
inline bool overlap(const Span& one, const Span& other) {
  return one.space == other.space && one.first_bit < other.end_bit() &&
         other.first_bit < one.end_bit();
}

/// Returns the bits of all `spans` in as few spans as possible, sorted by space and first bit.
/// Spans that overlap or touch become one.
std::vector<Span> merged(std::vector<Span> spans);

/// Returns `bits` (1 to 64) bits of the image from bit `from_bit` as a number, lowest first. Bits
/// past the end of `image` read as 0.
std::uint64_t bits_at(ByteView image, std::size_t from_bit, std::uint32_t bits);
/// Copies `bits` bits of `image`, from bit `from_bit`, to a new image that starts at bit 0. Bits
/// past the end of `image` read as 0.
Bytes extract_bits(ByteView image, std::uint32_t from_bit, std::uint32_t bits);
/// Overwrites `bits` bits of `image`, from bit `to_bit`, with the first bits of `part`. `image`
/// must hold them all.
void insert_bits(Bytes& image, std::uint32_t to_bit, ByteView part, std::uint32_t bits);

}  // namespace fxagent
