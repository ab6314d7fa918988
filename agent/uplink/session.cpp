#include "agent/uplink/session.h"

#include <malloc.h>

#include <algorithm>
#include <utility>

#include "agent/log/log.h"

namespace fxagent {
namespace {

using std::chrono::seconds;

constexpr seconds kConnectPatience{30};    // longer than the library's own connect time-out
constexpr seconds kNoAcknowledgement{30};  // a broker silent for this long is abandoned
constexpr seconds kSteady{10};             // a connection that lasts this long is stable
// It must also last this many times as long as the pause before it. Another agent with our id
// pauses as often as we do, and at most two and a half times as long.
constexpr int kSteadyPauses = 3;
constexpr seconds kLastRetry{30};
// A broker that restarts, or accepts a user again, is reached within 5 s. After a longer outage
// than this, the delay grows to kLastRetry.
constexpr std::chrono::minutes kShortOutage{5};
constexpr seconds kLastRetryOfShortOutage{4};
// Two agents with one id take over each other's session; each doubles its delay up to this limit.
constexpr seconds kLastRetryOfThrown{60};
constexpr std::chrono::milliseconds kBetweenLooks{100};  // between checks of the connection
constexpr seconds kLibraryForgot{1};                     // time for the library to report a loss
constexpr seconds kSubackWithin{1};                      // before commands count as not received
constexpr seconds kGoodbye{2};     // wait for Disconnected before connecting anyway
constexpr seconds kCatchUp{1};     // between checks if enough results are delivered
constexpr int kSilenceIsSlow = 2;  // an unanswered SUBSCRIBE begins with this many failures: 4 s
constexpr seconds kLastSubscribe{60};
constexpr seconds kLeftoversFor{10};  // search for topics of removed devices

}  // namespace

Session::Session(const MqttConfig& mqtt, std::string base, Broker& broker, Outgoing& outgoing,
                 JitteredBackoff& backoff, Listener& listener)
    : mqtt_(mqtt),
      base_(std::move(base)),
      commands_filter_(base_ + "/+/command"),
      configs_filter_(base_ + std::string(kDesiredTopic)),
      broker_(broker),
      outgoing_(outgoing),
      backoff_(backoff),
      listener_(listener) {}

// ---- connection ---------------------------------------------------------------------------------

void Session::on(const Connected& event, SteadyTime now) {
  if (link_ != Link::connecting) return;
  link_ = Link::connected;
  starting_ = false;
  connected_at_ = now;
  last_up_ = now;
  failed_rounds_ = 0;
  last_failure_.clear();
  why_not_connected_.clear();
  outgoing_.begin(event);
  log::info("broker_connected",
            {{"server", server()}, {"window", std::to_string(outgoing_.window())}});
  // Our own retained topics are what we search for, and another agent may have our client id; No
  // Local would hide both. Our own state is subscribed to before commands, so that another agent is
  // detected before commands arrive.
  broker_.subscribe({base_ + "/state", /*no_local=*/false});
  subscribe_to_commands(now);
  broker_.subscribe({base_ + "/+/state", /*no_local=*/false});
  broker_.subscribe({base_ + "/+/meta", /*no_local=*/false});
  if (hears_configs_) broker_.subscribe({configs_filter_, /*no_local=*/false});
  leftovers_until_ = now + kLeftoversFor;
  listener_.connection_began(now);
}

void Session::on(const ConnectFailed& event, SteadyTime now) {
  if (link_ != Link::connecting) return;
  if (event.text != last_failure_) {  // log a repeated failure once
    log::warn("broker_unreachable", {{"server", server()}, {"reason", event.text}});
    last_failure_ = event.text;
  }
  why_not_connected_ = event.text;
  link_ = Link::waiting;
  starting_ = false;
  receive_maximum_ = kReceiveMaximum;
  listener_.attempt_failed(now);
  retry_after_failure(now);
}

void Session::on(const Lost& event, SteadyTime now) {
  if (link_ == Link::connecting) return on(ConnectFailed{event.text}, now);
  if (link_ != Link::connected) return;
  log::warn("broker_lost", {{"server", server()}, {"reason", event.text}});
  why_not_connected_ = event.text;
  if (event.reason_code == kSessionTakenOver) listener_.session_taken_over();
  receive_maximum_ = kReceiveMaximum;
  end(now);
  retry_after_loss(now);
}

void Session::on(const Disconnected&, SteadyTime now) {
  if (link_ == Link::leaving) retry_at_ = now;
}

void Session::keep(SteadyTime now, bool may_hear) {
  if (link_ == Link::connecting && now >= connect_deadline_) {
    broker_.disconnect();
    on(ConnectFailed{"no answer"}, now);
  }
  watch(now);
  keep_subscribed(now, may_hear);
  if ((link_ == Link::waiting || link_ == Link::leaving) && now >= retry_at_) connect(now);
  if (link_ == Link::connected && leftovers_until_ && now >= *leftovers_until_) {
    leftovers_until_.reset();
    malloc_trim(0);  // return the memory of the initial burst to the system
  }
}

void Session::connect(SteadyTime now) {
  link_ = Link::connecting;
  connect_deadline_ = now + kConnectPatience;
  broker_.connect(server_, receive_maximum_);
}

void Session::end(SteadyTime now) {
  link_ = Link::waiting;
  last_up_ = now;
  lost_at_ = now;
  leftovers_until_.reset();
  down_since_.reset();
  suback_by_.reset();
  ask_again_at_.reset();
  unheard_ = 0;
  not_heard_why_.reset();
  paused_ = false;
  outgoing_.forget();
  listener_.connection_ended(now);
}

void Session::connect_anew(SteadyTime now) {
  log::warn(
      "broker_sends_too_far_ahead",
      {{"server", server()},
       {"note", "PUBACKs arrive late, after messages; connecting again with Receive Maximum 1"}});
  receive_maximum_ = 1;
  broker_.disconnect();
  end(now);
  link_ = Link::leaving;
  retry_at_ = now + kGoodbye;
}

void Session::begin_anew(SteadyTime now) {
  const bool was_connected = link_ == Link::connected;
  server_ = 0;
  failed_rounds_ = 0;
  thrown_rounds_ = 0;
  last_failure_.clear();
  refused_filters_.clear();
  receive_maximum_ = kReceiveMaximum;
  if (was_connected) {
    broker_.disconnect();
    end(now);
  }
  if (link_ == Link::connecting) listener_.attempt_failed(now);
  // An attempt without an answer gets no DISCONNECT: connect() abandons it.
  link_ = was_connected ? Link::leaving : Link::waiting;
  retry_at_ = was_connected ? now + kGoodbye : now;
}

void Session::hear_configs(bool heard) {
  if (heard == hears_configs_) return;
  hears_configs_ = heard;
  if (link_ != Link::connected) return;  // takes effect with the next connection
  if (heard)
    broker_.subscribe({configs_filter_, /*no_local=*/false});
  else
    broker_.unsubscribe(configs_filter_);
}

void Session::begin_end(SteadyTime now) {
  if (link_ == Link::connected) broker_.unsubscribe(commands_filter_);
  if (link_ == Link::leaving) connect(now);
}

void Session::give_up(SteadyTime now) {
  if (link_ != Link::connected) broker_.disconnect();
  end(now);
}

/// Detects losses that the library does not report. Health is published at least every minute; if
/// the broker does not acknowledge it, the connection is lost.
void Session::watch(SteadyTime now) {
  const auto unanswered_since = outgoing_.unanswered_since();
  if (link_ == Link::connected && unanswered_since &&
      now - *unanswered_since >= kNoAcknowledgement) {
    broker_.disconnect();
    on(Lost{"no acknowledgement for 30 s"}, now);
  }
  if (link_ != Link::connected) return down_since_.reset();
  // is_connected() takes a lock for which the library's threads wait, so it is called rarely.
  if (!down_since_ && now < look_again_) return;
  look_again_ = now + kBetweenLooks;
  if (broker_.is_connected()) return down_since_.reset();
  if (!down_since_) down_since_ = now;
  if (now - *down_since_ >= kLibraryForgot) on(Lost{"found closed"}, now);
}

SteadyTime Session::next_wake() const {
  SteadyTime wake = SteadyTime::max();
  const auto at = [&wake](std::optional<SteadyTime> time) {
    wake = std::min(wake, time.value_or(wake));
  };
  if (link_ == Link::waiting || link_ == Link::leaving) at(retry_at_);
  if (link_ == Link::connecting) at(connect_deadline_);
  at(leftovers_until_);
  if (link_ != Link::connected) return wake;
  if (const auto since = outgoing_.unanswered_since()) at(*since + kNoAcknowledgement);
  if (down_since_) at(*down_since_ + kLibraryForgot);
  at(suback_by_);
  at(ask_again_at_);
  return wake;
}

void Session::retry_after_failure(SteadyTime now) {
  server_ = (server_ + 1) % mqtt_.servers.size();
  const bool short_outage = last_up_ && now - *last_up_ < kShortOutage;
  retry_at_ = server_ != 0
                  ? now
                  : now + backoff_.after(failed_rounds_++,
                                         short_outage ? kLastRetryOfShortOutage : kLastRetry);
}

SteadyTime::duration Session::steady_after() const {
  return std::max<SteadyTime::duration>(kSteady, kSteadyPauses * last_pause_);
}

void Session::retry_after_loss(SteadyTime now) {
  if (now - connected_at_ >= steady_after()) {
    server_ = 0;
    thrown_rounds_ = 0;
  } else {
    server_ = (server_ + 1) % mqtt_.servers.size();
    if (server_ != 0) {
      retry_at_ = now;
      return;
    }
  }
  last_pause_ = backoff_.after(thrown_rounds_++, kLastRetryOfThrown);
  retry_at_ = now + last_pause_;
}

// ---- subscription to commands -------------------------------------------------------------------

void Session::on(const Subscribed& event, SteadyTime now) {
  if (link_ != Link::connected) return;
  if (event.filter != commands_filter_) {
    if (event.granted)
      refused_filters_.erase(event.filter);
    else if (refused_filters_.insert(event.filter).second)
      log::error("subscription_refused", {{"filter", event.filter}, {"reason", event.text}});
    return;
  }
  if (paused_) return;  // answers a SUBSCRIBE that has been withdrawn since
  if (!event.granted) return unheard(event.text, now);
  suback_by_.reset();
  ask_again_at_.reset();
  unheard_ = 0;
  if (!not_heard_why_) return;
  not_heard_why_.reset();
  listener_.subscription_changed();
  log::info("subscription_granted", {{"filter", event.filter}});
}

void Session::subscribe_to_commands(SteadyTime now) {
  ask_again_at_.reset();
  suback_by_ = now + kSubackWithin;
  broker_.subscribe({commands_filter_, /*no_local=*/true});
}

void Session::keep_subscribed(SteadyTime now, bool may_hear) {
  if (link_ != Link::connected) return;
  if (suback_by_ && now >= *suback_by_) {
    unheard_ = std::max(unheard_, kSilenceIsSlow);
    unheard("the broker does not confirm the subscription", now);
  }
  if (!ask_again_at_ || now < *ask_again_at_) return;
  if (paused_ && !may_hear) {
    ask_again_at_ = now + kCatchUp;
    return;
  }
  paused_ = false;
  subscribe_to_commands(now);
}

void Session::unheard(const std::string& reason, SteadyTime now) {
  suback_by_.reset();
  ask_again_at_ = now + backoff_.after(unheard_++, kLastSubscribe);
  if (not_heard_why_ == reason) return;  // log a repeated reason once
  not_heard_why_ = reason;
  listener_.subscription_changed();
  log::error("subscription_refused", {{"filter", commands_filter_}, {"reason", reason}});
}

void Session::pause_commands(SteadyTime now) {
  paused_ = true;
  suback_by_.reset();
  ask_again_at_ = now + kCatchUp;
  not_heard_why_ = "more commands arrive than the agent can answer";
  listener_.subscription_changed();
  broker_.unsubscribe(commands_filter_);
  log::error("commands_paused", {{"reason", *not_heard_why_}});
}

}  // namespace fxagent
