#include "agent/field/bus/echo.h"

#include <algorithm>

namespace fxagent {

Bytes Echo::answered(Bytes before, const Bytes& request, bool shows) {
  const auto own = std::search(before.begin(), before.end(), request.begin(), request.end());
  const bool echoed = own != before.end();
  if (shows) {
    in_a_row_ = echoed ? std::min(in_a_row_ + 1, kFound) : 0;
    returns_nothing_ = before.empty();
  }
  if (echoed) before.erase(own, own + static_cast<std::ptrdiff_t>(request.size()));
  return before;
}

bool Echo::may_be(ByteView bytes) const {
  if (returns_nothing_) return false;
  // The line echoes. Either this is not detected yet, or the echoed bytes get no answer.
  return std::ranges::equal(bytes, last_sent_) || !std::ranges::search(unanswered_, bytes).empty();
}

}  // namespace fxagent
