#include "agent/uplink/session/connect_schedule.h"

#include <algorithm>
#include <chrono>

namespace fxagent {
namespace {

using std::chrono::seconds;

constexpr seconds kSteady{10};  // a connection that lasts this long is stable
// It must also last this many times as long as the pause before it. Another agent with our id
// pauses as often as we do, and at most two and a half times as long, plus the spread.
constexpr int kSteadyPauses = 3;
constexpr seconds kLastRetry{30};
// A broker that restarts, or accepts a user again, is reached within 5 s. After a longer outage
// than this, the delay grows to kLastRetry.
constexpr std::chrono::minutes kShortOutage{5};
constexpr seconds kLastRetryOfShortOutage{4};
// Two agents with one id take over each other's session; each doubles its delay up to this limit.
constexpr seconds kLastRetryOfThrown{60};

}  // namespace

SteadyTime::duration ConnectSchedule::steady_after() const {
  return std::max<SteadyTime::duration>(kSteady,
                                        kSteadyPauses * last_pause_ + mqtt_.reconnect_spread);
}

void ConnectSchedule::connection_began(SteadyTime now) {
  last_up_ = now;
  failed_rounds_ = 0;
}

SteadyTime ConnectSchedule::after_failure(SteadyTime now) {
  server_ = (server_ + 1) % mqtt_.servers.size();
  const bool short_outage = last_up_ && now - *last_up_ < kShortOutage;
  if (server_ != 0) return now;
  // The spread is exact here: times that were drawn evenly over it stay so.
  return now +
         std::max<SteadyTime::duration>(
             backoff_.after(failed_rounds_++, short_outage ? kLastRetryOfShortOutage : kLastRetry),
             mqtt_.reconnect_spread);
}

SteadyTime ConnectSchedule::after_loss(SteadyTime connected_at, SteadyTime now) {
  if (now - connected_at >= steady_after()) {
    server_ = 0;
    thrown_rounds_ = 0;
  } else {
    server_ = (server_ + 1) % mqtt_.servers.size();
    if (server_ != 0) return now;
  }
  last_pause_ = backoff_.after(thrown_rounds_++, kLastRetryOfThrown);
  return now + last_pause_ + backoff_.up_to(mqtt_.reconnect_spread);
}

void ConnectSchedule::restart() {
  server_ = 0;
  failed_rounds_ = 0;
  thrown_rounds_ = 0;
}

}  // namespace fxagent
