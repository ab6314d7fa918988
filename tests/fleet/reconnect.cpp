#include "tests/fleet/reconnect.h"

#include <algorithm>

namespace fxfleet {

using std::chrono::minutes;
using std::chrono::seconds;

milliseconds Reconnect::patience() const {
  return servers_ > 1 && failed_rounds_ == 0 ? seconds(3) : seconds(10);
}

void Reconnect::connected(Time now) {
  connected_at_ = now;
  last_up_ = now;
  failed_rounds_ = 0;
}

Time Reconnect::after_failure(Time now) {
  if (++position_ < servers_) return now;
  first_ = position_ = 0;
  const bool is_short = last_up_ && now - *last_up_ < minutes(5);
  return now + delay(failed_rounds_++, is_short ? seconds(4) : seconds(30));
}

Time Reconnect::after_loss(Time now) {
  last_up_ = now;
  if (now - connected_at_ >= std::max<milliseconds>(seconds(10), 3 * last_pause_)) {
    // Of three servers this is not the agent's order, but the lost one is the last here, too.
    first_ = server() + 1;
    position_ = 0;
    thrown_rounds_ = 1;
    last_pause_ = milliseconds(250) + up_to(seconds(1));
    return now + last_pause_;
  }
  if (++position_ < servers_) return now + up_to(seconds(1));
  first_ = position_ = 0;
  last_pause_ = delay(thrown_rounds_++, seconds(60));
  return now + last_pause_;
}

milliseconds Reconnect::delay(int failures, milliseconds longest) {
  const auto plain = std::min(longest, milliseconds(1000) * (1 << std::clamp(failures, 0, 6)));
  return plain + up_to(plain / 4);
}

milliseconds Reconnect::up_to(milliseconds most) {
  return milliseconds(std::uniform_int_distribution<long>(0, most.count())(random_));
}

}  // namespace fxfleet
