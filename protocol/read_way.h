// Ways to read a space of device memory (value/span.h): the read commands of a protocol, each with
// its limits. A codec returns those of its model (AddressSpace::read_ways()); the planner
// (plan/plan.h) chooses among them. Plain data; all lengths are in bits of the image.
#pragma once

#include <cstdint>
#include <optional>

#include "protocol/value/span.h"

namespace fxagent {

/// A command that reads one run of bits. The run
/// * lies inside [first_bit, end_bit),
/// * begins at a multiple of `align_bits`,
/// * consists of whole units of `unit_bits`, at most `max_bits` together.
///
/// Example: Modbus function 03 reads up to 125 of 65,536 registers of 16 bits:
///   {.end_bit = 65536 * 16, .align_bits = 16, .unit_bits = 16, .max_bits = 125 * 16}
struct ReadWay {
  /// Number of this way in its codec, for Read::way. No two ways of a space that reach the same
  /// bits share one.
  std::uint8_t way = 0;
  /// A point is read by the lowest tier that reaches it. No read serves points of two tiers.
  std::uint8_t tier = 0;
  std::uint32_t first_bit = 0;
  std::uint32_t end_bit = 0;
  std::uint32_t align_bits = 8;
  std::uint32_t unit_bits = 8;
  std::uint32_t max_bits = 512;
  /// Longest run of unrequested bits between two requested ones that a read may include.
  std::uint32_t max_gap_bits = 0xFFFFFFFF;
  /// 0: a read is an exchange of its own. Otherwise it is a part of a Gather, if need be its only
  /// part, by the GatherCommand of this number, and the limits above are those of a part. Example:
  /// a part of a random read is a word or a double word, so unit_bits is 16 and max_bits is 32.
  std::uint8_t gather = 0;
};

/// A command that reads several places in one frame (random read, block read). Its parts may be in
/// different spaces; each is a read by a way that names this command.
struct GatherCommand {
  std::uint8_t gather = 1;  ///< number of the command in its codec, above 0
  std::uint32_t max_parts = 1;
  std::uint32_t max_bits = 0xFFFFFFFF;  ///< of all parts together
};

/// A run of bits of one space: [first, end).
struct Extent {
  std::uint32_t first = 0;
  std::uint32_t end = 0;
  friend bool operator==(const Extent&, const Extent&) = default;
};

/// Returns the shortest read by `way` that covers `wanted`. nullopt if the way does not reach it or
/// cannot carry that much. Example: if a way reads only whole words of 16 bits, from a multiple of
/// 16 on, [20, 30) takes the read [16, 32).
std::optional<Extent> fit(const ReadWay& way, const Extent& wanted);
/// True if reads by `way`, perhaps several, cover `span`.
bool reaches(const ReadWay& way, const Span& span);

/// Returns the smallest multiple of `step` that is not below `value`.
constexpr std::uint32_t round_up(std::uint32_t value, std::uint32_t step) {
  return (value + step - 1) / step * step;
}

}  // namespace fxagent
