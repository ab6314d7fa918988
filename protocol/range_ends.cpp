#include "protocol/range_ends.h"

#include <algorithm>

namespace fxagent {
namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }

}  // namespace

RangeEnds range_ends(std::string_view text) {
  const auto trimmed = [](std::string_view end) {
    const auto first = end.find_first_not_of(" \t");
    if (first == end.npos) return std::string_view();
    return end.substr(first, end.find_last_not_of(" \t") - first + 1);
  };
  for (const std::string_view between : {"..", "-"})
    if (const auto at = text.find(between); at != text.npos)
      return {trimmed(text.substr(0, at)), trimmed(text.substr(at + between.size()))};
  return {trimmed(text), std::nullopt};
}

std::string last_end(const RangeEnds& ends) {
  std::string last(ends.last.value_or(ends.first));
  if (last.empty() || !is_digit(last.front())) return last;
  const auto* letters_end = std::ranges::find_if_not(ends.first, is_letter);
  // "hr:100" has a table and no letters. Only Modbus knows what its numbers mean.
  if (letters_end == ends.first.end() || !is_digit(*letters_end)) return last;
  return std::string(ends.first.begin(), letters_end) + last;
}

}  // namespace fxagent
