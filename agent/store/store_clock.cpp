#include "agent/store/store_clock.h"

#include <cstdlib>

#include "agent/log/log.h"

namespace fxagent {

using std::chrono::duration_cast;
using std::chrono::milliseconds;

void StoreClock::note(SteadyTime now, std::int64_t utc_ms) {
  if (at_) {
    const std::int64_t passed = duration_cast<milliseconds>(now - *at_).count();
    const std::int64_t set_by = utc_ms - disk_.utc_ms() - passed;
    if (std::abs(set_by) >= milliseconds(kClockSet).count()) {
      log::warn("clock_set", {{"by_ms", std::to_string(set_by)}});
      unmoved_ms_ += set_by;
      journal_.move_waiting_times(set_by);
    }
  }
  at_ = now;
  disk_.set_utc_ms(utc_ms);
}

void StoreClock::move_stored_times() {
  if (unmoved_ms_ == 0) return;
  const bool done = disk_.commit("clock", StoreDisk::Sync::as_configured, [this] {
    samples_.move_times(unmoved_ms_);
    journal_.move_stored_times(unmoved_ms_);
  });
  if (done) unmoved_ms_ = 0;
}

}  // namespace fxagent
