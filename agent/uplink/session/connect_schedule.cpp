#include "agent/uplink/session/connect_schedule.h"

#include <algorithm>
#include <chrono>

namespace fxagent {
namespace {

using std::chrono::seconds;

constexpr seconds kPatience{30};  // longer than the library's own connect time-out
// A broker under load, or behind a slow line, has the library's 10 s in the next round.
constexpr seconds kPatienceOfFirstRound{3};
constexpr seconds kSteady{10};  // a connection that lasts this long is stable
// It must also last this many times as long as the pause before it. Another agent with our id
// pauses as often as we do, and at most two and a half times as long, plus the spread.
constexpr int kSteadyPauses = 3;
// After the loss of a stable connection the agents of a dead broker connect within a second. A
// fleet adds `reconnect_spread_s`.
constexpr seconds kFirstSpread{1};
// With one server, no agent connects at the moment of its death: the broker may be restarting.
constexpr std::chrono::milliseconds kPauseOfOnlyServer{250};
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

SteadyTime::duration ConnectSchedule::patience() const {
  return mqtt_.servers.size() > 1 && failed_rounds_ == 0 ? kPatienceOfFirstRound : kPatience;
}

void ConnectSchedule::connection_began(SteadyTime now) {
  last_up_ = now;
  failed_rounds_ = 0;
}

std::size_t ConnectSchedule::index() const {
  if (!lost_) return position_;
  if (position_ + 1 == mqtt_.servers.size()) return *lost_;
  return position_ < *lost_ ? position_ : position_ + 1;
}

void ConnectSchedule::begin_round(std::optional<std::size_t> lost) {
  lost_ = lost;
  position_ = 0;
}

bool ConnectSchedule::next_of_round() {
  if (position_ + 1 >= mqtt_.servers.size()) {
    begin_round(std::nullopt);
    return false;
  }
  ++position_;
  return true;
}

SteadyTime ConnectSchedule::after_failure(SteadyTime now) {
  const bool short_outage = last_up_ && now - *last_up_ < kShortOutage;
  if (next_of_round()) return now;
  // The spread is exact here: times that were drawn evenly over it stay so.
  return now +
         std::max<SteadyTime::duration>(
             backoff_.after(failed_rounds_++, short_outage ? kLastRetryOfShortOutage : kLastRetry),
             mqtt_.reconnect_spread);
}

SteadyTime ConnectSchedule::after_loss(SteadyTime connected_at, SteadyTime now) {
  if (now - connected_at >= steady_after()) {
    begin_round(index());
    last_pause_ = backoff_.up_to(kFirstSpread);
    if (mqtt_.servers.size() == 1) last_pause_ += kPauseOfOnlyServer;
    thrown_rounds_ = 1;
    return now + last_pause_ + backoff_.up_to(mqtt_.reconnect_spread);
  }
  if (next_of_round())
    return now + backoff_.up_to(std::max<seconds>(kFirstSpread, mqtt_.reconnect_spread));
  last_pause_ = backoff_.after(thrown_rounds_++, kLastRetryOfThrown);
  return now + last_pause_ + backoff_.up_to(mqtt_.reconnect_spread);
}

void ConnectSchedule::restart() {
  begin_round(std::nullopt);
  failed_rounds_ = 0;
  thrown_rounds_ = 0;
}

}  // namespace fxagent
