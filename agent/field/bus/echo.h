// Recognises a line that returns every byte sent on it, without being configured to: an adapter of
// a two-wire line with its receiver on. Pure. Field thread.
#pragma once

#include <algorithm>

#include "protocol/value/bytes.h"

namespace fxagent {

class Echo final {
 public:
  /// True if several consecutive reads came back. A read that does not come back resets it. While
  /// true, a command's echo is not taken for its answer.
  bool is_found() const { return in_a_row_ >= kFound; }

  void sent(const Bytes& frame) { last_sent_ = frame; }
  /// Records that no answer follows what was sent: its echo may precede the next answer.
  void sent_unanswered(const Bytes& bytes) { last_sent_ = unanswered_ = bytes; }
  /// Learns from the bytes received before the answer to a read whether the line echoes. Call only
  /// if its echo was not removed earlier.
  void learn(ByteView before, const Bytes& request) {
    const bool echoed = !std::ranges::search(before, request).empty();
    in_a_row_ = echoed ? std::min(in_a_row_ + 1, kFound) : 0;
    returns_nothing_ = before.empty();
  }
  /// Returns the bytes received before an answer to `request`, without its echo.
  static Bytes without_echo(Bytes before, const Bytes& request) {
    const auto echo = std::ranges::search(before, request);
    before.erase(echo.begin(), echo.end());
    return before;
  }
  /// Records that an answer has come since sent_unanswered().
  void forget_unanswered() { unanswered_.clear(); }

  /// True if `bytes` are, or may be, an echo. False on a line whose last read had no echo.
  bool may_be(ByteView bytes) const {
    if (returns_nothing_) return false;
    // The line echoes. Either this is not detected yet, or the echoed bytes get no answer.
    return std::ranges::equal(bytes, last_sent_) ||
           !std::ranges::search(unanswered_, bytes).empty();
  }

 private:
  static constexpr int kFound = 3;

  int in_a_row_ = 0;              ///< consecutive reads whose request came back
  bool returns_nothing_ = false;  ///< nothing came before the answer to the last read
  Bytes last_sent_;               ///< last frame or closing
  Bytes unanswered_;              ///< last bytes without an answer
};

}  // namespace fxagent
