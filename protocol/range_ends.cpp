#include "protocol/range_ends.h"

namespace fxagent {

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

std::string last_end(const RangeEnds& ends, std::string_view letters) {
  std::string last(ends.last.value_or(ends.first));
  const bool is_number = !last.empty() && last.front() >= '0' && last.front() <= '9';
  return ends.last && is_number ? std::string(letters) + last : last;
}

}  // namespace fxagent
