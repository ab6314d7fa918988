#include "tests/fleet/reconnect.h"

#include <algorithm>

namespace fxfleet {

using std::chrono::minutes;
using std::chrono::seconds;

void Reconnect::connected(Time now) {
  connected_at_ = now;
  last_up_ = now;
  failed_rounds_ = 0;
}

Time Reconnect::after_failure(Time now) {
  server_ = (server_ + 1) % servers_;
  if (server_ != 0) return now;
  const bool is_short = last_up_ && now - *last_up_ < minutes(5);
  return now + delay(failed_rounds_++, is_short ? seconds(4) : seconds(30));
}

Time Reconnect::after_loss(Time now) {
  last_up_ = now;
  if (now - connected_at_ >= std::max<milliseconds>(seconds(10), 3 * last_pause_)) {
    server_ = 0;
    thrown_rounds_ = 0;
  } else {
    server_ = (server_ + 1) % servers_;
    if (server_ != 0) return now;
  }
  last_pause_ = delay(thrown_rounds_++, seconds(60));
  return now + last_pause_;
}

milliseconds Reconnect::delay(int failures, milliseconds longest) {
  const auto plain = std::min(longest, milliseconds(1000) * (1 << std::clamp(failures, 0, 6)));
  return plain + milliseconds(std::uniform_int_distribution<long>(0, plain.count() / 4)(random_));
}

}  // namespace fxfleet
