// Recognises a line that returns every byte sent on it, without being configured to: an adapter of
// a two-wire line with its receiver on. Pure. Field thread.
#pragma once

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
  /// Takes the bytes that came before an answer to `request`, and returns those that are not its
  /// echo. With `shows` they show whether the line echoes requests.
  Bytes answered(Bytes before, const Bytes& request, bool shows);
  /// Records that an answer has come since sent_unanswered().
  void forget_unanswered() { unanswered_.clear(); }

  /// True if `bytes` are, or may be, an echo. False on a line whose last read had no echo.
  bool may_be(ByteView bytes) const;

 private:
  static constexpr int kFound = 3;

  int in_a_row_ = 0;              ///< consecutive reads whose request came back
  bool returns_nothing_ = false;  ///< nothing came before the answer to the last read
  Bytes last_sent_;               ///< last frame or closing
  Bytes unanswered_;              ///< last bytes without an answer
};

}  // namespace fxagent
