#include "protocol/range_ends.h"

#include <algorithm>

namespace fxagent {
namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }

}  // namespace

std::string last_end(const RangeEnds& ends) {
  std::string last(ends.last.value_or(ends.first));
  if (last.empty() || !is_digit(last.front())) return last;
  const auto* letters_end = std::ranges::find_if_not(ends.first, is_letter);
  // "hr:100" has a table and no letters. Only Modbus knows what its numbers mean.
  if (letters_end == ends.first.end() || !is_digit(*letters_end)) return last;
  return std::string(ends.first.begin(), letters_end) + last;
}

}  // namespace fxagent
