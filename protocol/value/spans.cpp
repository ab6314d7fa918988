#include "protocol/value/spans.h"

#include <algorithm>
#include <utility>

namespace fxagent {

std::vector<Span> merged(std::vector<Span> spans) {
  std::sort(spans.begin(), spans.end(), [](const Span& a, const Span& b) {
    return std::pair(a.space, a.first_bit) < std::pair(b.space, b.first_bit);
  });
  std::vector<Span> runs;
  for (const Span& span : spans) {
    if (runs.empty() || runs.back().space != span.space || runs.back().end_bit() < span.first_bit)
      runs.push_back(span);
    else
      runs.back().bits = std::max(runs.back().end_bit(), span.end_bit()) - runs.back().first_bit;
  }
  return runs;
}

}  // namespace fxagent
