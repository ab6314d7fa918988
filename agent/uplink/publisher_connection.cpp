// How the publisher keeps its connection: a loss is noticed whoever tells it or not, the next
// attempt comes in time and never in haste, and the subscription to commands is asked for until it
// is granted.
#include <algorithm>
#include <type_traits>
#include <utility>

#include "agent/log/log.h"
#include "agent/uplink/publisher.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr seconds kNoAcknowledgement{30};  // a broker that is silent for so long is given up
constexpr seconds kSteady{10};             // a connection that lived so long was a good one,
constexpr int kSteadyPauses = 2;           // and so many times as long as the pause before it
constexpr seconds kFirstRetry{1};
constexpr seconds kLastRetry{30};
// A broker that restarts, or lets a user in again, is met within 5 s; one that is away for longer
// than this is not in such a hurry.
constexpr std::chrono::minutes kShortOutage{5};
constexpr seconds kLastRetryOfShortOutage{4};
// Two agents with one id throw each other off: each stays away ever longer.
constexpr seconds kLastRetryOfThrown{60};
constexpr seconds kLibraryForgot{1};  // to tell that the connection is gone
constexpr seconds kSubackWithin{1};   // until commands count as unheard
constexpr seconds kGoodbye{2};        // until Disconnected, or else nothing more is waited for
constexpr seconds kCatchUp{1};        // until it is asked again whether enough results are out
constexpr int kSilenceIsSlow = 2;     // failures that an unanswered SUBSCRIBE begins with: 4 s
constexpr seconds kLastSubscribe{60};

}  // namespace

// ---- the subscription to commands ---------------------------------------------------------------

void Publisher::on(const Subscribed& event, SteadyTime now) {
  if (link_ != Link::connected) return;
  if (event.filter != base_ + "/+/command") {
    if (!event.granted)
      log::error("subscription_refused", {{"filter", event.filter}, {"reason", event.text}});
    return;
  }
  if (paused_) return;  // the answer to what was taken back meanwhile
  if (!event.granted) return commands_unheard(event.text, now);
  suback_by_.reset();
  ask_again_at_.reset();
  unheard_ = 0;
  if (!deaf_) return;
  deaf_.reset();
  due_[{Notice::agent_state, 0, {}}] = {};
  log::info("subscription_granted", {{"filter", event.filter}});
}

void Publisher::subscribe_to_commands(SteadyTime now) {
  ask_again_at_.reset();
  suback_by_ = now + kSubackWithin;
  broker_.subscribe({base_ + "/+/command", /*no_local=*/true});
}

void Publisher::keep_subscribed(SteadyTime now) {
  if (link_ != Link::connected) return;
  if (suback_by_ && now >= *suback_by_) {
    unheard_ = std::max(unheard_, kSilenceIsSlow);
    commands_unheard("the broker does not confirm the subscription", now);
  }
  if (!ask_again_at_ || now < *ask_again_at_) return;
  if (paused_ && result_bytes_ > settings_.result_bytes / 2) {
    ask_again_at_ = now + kCatchUp;
    return;
  }
  paused_ = false;
  subscribe_to_commands(now);
}

void Publisher::commands_unheard(const std::string& reason, SteadyTime now) {
  suback_by_.reset();
  ask_again_at_ = now + back_off(unheard_++, kLastSubscribe);
  if (deaf_ == reason) return;  // a repeated one is not news
  deaf_ = reason;
  due_[{Notice::agent_state, 0, {}}] = {};
  log::error("subscription_refused", {{"filter", base_ + "/+/command"}, {"reason", reason}});
}

/// More commands come than can be answered, and they cannot be held back: what they would fill is
/// memory. The agent's state says so; it listens again when half of the results are out.
void Publisher::stop_listening(SteadyTime now) {
  paused_ = true;
  suback_by_.reset();
  ask_again_at_ = now + kCatchUp;
  deaf_ = "more commands come than can be answered";
  due_[{Notice::agent_state, 0, {}}] = {};
  broker_.unsubscribe(base_ + "/+/command");
  log::error("commands_paused", {{"reason", *deaf_}});
}

// ---- losses that nobody tells -------------------------------------------------------------------

/// Whether a PUBACK is to come; what has QoS 0 is over when it was handed to the socket.
bool Publisher::is_acknowledged_by_broker(const Flight& flight) const {
  return config_.mqtt.qos != 0 || !(std::holds_alternative<LiveFlight>(flight) ||
                                    std::holds_alternative<HistoryFlight>(flight));
}

/// The broker answers. What it need not answer shows that only where no answer is owed.
void Publisher::note_acknowledgement(const Flight& flight, SteadyTime now) {
  const auto owed = [this](const auto& other) { return is_acknowledged_by_broker(other.second); };
  if (!is_acknowledged_by_broker(flight) && std::any_of(flights_.begin(), flights_.end(), owed))
    return;
  unacknowledged_since_ = flights_.empty() ? std::nullopt : std::optional(now);
}

/// Finds a loss that nobody told. Whatever the library leaves out: a minute passes at most until
/// health is published, and then the broker answers, or there is none.
void Publisher::watch_connection(SteadyTime now) {
  if (link_ == Link::connected && unacknowledged_since_ &&
      now - *unacknowledged_since_ >= kNoAcknowledgement) {
    broker_.disconnect();
    on(Lost{"no acknowledgement for 30 s"}, now);
  }
  if (broker_runs_ahead()) connect_anew(now);
  if (link_ != Link::connected || broker_.is_connected()) return down_since_.reset();
  if (!down_since_) down_since_ = now;
  if (now - *down_since_ >= kLibraryForgot) on(Lost{"found closed"}, now);
}

/// Asks the same server for one message at a time. What has come is answered; what the broker had
/// queued goes with the session, as with every loss.
void Publisher::connect_anew(SteadyTime now) {
  log::warn(
      "broker_sends_too_far_ahead",
      {{"server", config_.mqtt.servers.at(server_)},
       {"note", "PUBACKs come late behind messages; connecting anew with Receive Maximum 1"}});
  receive_maximum_ = 1;
  broker_.disconnect();
  connection_over(now);
  link_ = Link::leaving;
  retry_at_ = now + kGoodbye;
}

/// When keep_connected() has something to do at the latest, while connected.
SteadyTime Publisher::watch_wake() const {
  SteadyTime wake = SteadyTime::max();
  const auto at = [&wake](SteadyTime time) { wake = std::min(wake, time); };
  if (unacknowledged_since_) at(*unacknowledged_since_ + kNoAcknowledgement);
  if (down_since_) at(*down_since_ + kLibraryForgot);
  if (suback_by_) at(*suback_by_);
  if (ask_again_at_) at(*ask_again_at_);
  return wake;
}

// ---- the next attempt ---------------------------------------------------------------------------

void Publisher::retry_after_failure(SteadyTime now) {
  server_ = (server_ + 1) % config_.mqtt.servers.size();
  const bool short_outage = last_up_ && now - *last_up_ < kShortOutage;
  retry_at_ = server_ != 0 ? now
                           : now + back_off(failed_rounds_++,
                                            short_outage ? kLastRetryOfShortOutage : kLastRetry);
}

void Publisher::retry_after_loss(SteadyTime now) {
  const SteadyTime::duration lived = now - connected_at_;
  if (lived >= kSteady && lived >= kSteadyPauses * last_pause_) {
    server_ = 0;
    thrown_rounds_ = 0;
  } else {
    server_ = (server_ + 1) % config_.mqtt.servers.size();
    if (server_ != 0) {
      retry_at_ = now;
      return;
    }
  }
  last_pause_ = back_off(thrown_rounds_++, kLastRetryOfThrown);
  retry_at_ = now + last_pause_;
}

SteadyTime::duration Publisher::back_off(int failures) { return back_off(failures, kLastRetry); }

/// 1 s after the first failure, twice as much after each further one, at most `longest`; and up to
/// a quarter more, by chance.
SteadyTime::duration Publisher::back_off(int failures, milliseconds longest) {
  const auto plain = std::min<milliseconds>(longest, kFirstRetry * (1 << std::min(failures, 6)));
  std::uniform_int_distribution<std::int64_t> extra(0, plain.count() / 4);
  return plain + milliseconds(extra(jitter_));
}

}  // namespace fxagent
