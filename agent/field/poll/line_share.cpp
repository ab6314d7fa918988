#include "agent/field/poll/line_share.h"

#include <algorithm>

namespace fxagent {

using std::chrono::nanoseconds;

bool LineShare::command_goes_first(Polls polls) {
  if (commands_ == 0) owed_to_polls_ = {};
  const bool polls_turn = polls == Polls::due && owed_to_polls_.count() > 0;
  return commands_ > 0 && !polls_turn;
}

nanoseconds LineShare::share_of(nanoseconds commands) const {
  const double factor = poll_share_ / (1.0 - poll_share_);
  return nanoseconds(static_cast<std::int64_t>(static_cast<double>(commands.count()) * factor));
}

nanoseconds LineShare::polls_between(nanoseconds line_time, nanoseconds longest_poll) const {
  const auto owed_already = std::max(owed_to_polls_, nanoseconds(0));
  if (line_time.count() <= 0 && owed_already.count() == 0) return {};
  // A poll runs while anything is owed, so the last one may overdraw by its whole length.
  return owed_already + share_of(line_time) + longest_poll;
}

nanoseconds LineShare::bound(nanoseconds own, nanoseconds ahead, nanoseconds longest_poll) const {
  return longest_poll + ahead + polls_between(ahead, longest_poll) + own;
}

nanoseconds LineShare::bound_giving_way(nanoseconds own, nanoseconds ahead,
                                        nanoseconds longest_poll) const {
  const auto commands = ahead + 2 * own;
  return longest_poll + commands + polls_between(commands, longest_poll);
}

}  // namespace fxagent
