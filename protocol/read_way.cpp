#include "protocol/read_way.h"

#include <limits>

namespace fxagent {

std::optional<Extent> fit(const ReadWay& way, const Extent& wanted) {
  if (wanted.first < way.first_bit || wanted.end > way.end_bit) return std::nullopt;
  std::uint32_t first = wanted.first - wanted.first % way.align_bits;
  if (first < way.first_bit) return std::nullopt;
  std::uint32_t bits = round_up(wanted.end - first, way.unit_bits);
  // A last unit that would end behind the last device is moved: the read begins earlier instead.
  while (bits > way.end_bit - first) {
    const std::uint32_t back = round_up(bits - (way.end_bit - first), way.align_bits);
    if (back > first - way.first_bit) return std::nullopt;
    first -= back;
    bits = round_up(wanted.end - first, way.unit_bits);
  }
  if (bits > way.max_bits) return std::nullopt;
  return Extent{first, first + bits};
}

bool reaches(const ReadWay& way, const Span& span) {
  ReadWay unlimited = way;
  unlimited.max_bits = std::numeric_limits<std::uint32_t>::max();
  return fit(unlimited, {span.first_bit, span.end_bit()}).has_value();
}

}  // namespace fxagent
