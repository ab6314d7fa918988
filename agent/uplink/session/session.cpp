#include "agent/uplink/session/session.h"

#include <algorithm>
#include <utility>

#include "agent/log/log.h"

namespace fxagent {
namespace {

using std::chrono::seconds;

constexpr seconds kNoAcknowledgement{30};  // a broker silent for this long is abandoned
constexpr std::chrono::milliseconds kBetweenChecks{100};  // between checks of the connection
constexpr seconds kLibraryForgot{1};                      // time for the library to report a loss
constexpr seconds kGoodbye{2};  // wait for Disconnected before connecting anyway

}  // namespace

Session::Session(Broker& broker, Outgoing& outgoing, const MqttConfig& mqtt,
                 JitteredBackoff& backoff, Listener listener, std::string profile, Will will)
    : broker_(broker),
      outgoing_(outgoing),
      connects_(mqtt, backoff),
      listener_(std::move(listener)),
      profile_(std::move(profile)),
      will_(will) {}

std::string Session::log_name() const {
  return server() + (profile_.empty() ? "" : " for " + profile_);
}

void Session::on(const Connected& event, SteadyTime now) {
  if (state_ != State::connecting) return;
  state_ = State::connected;
  starting_ = false;
  connected_at_ = now;
  connects_.connection_began(now);
  failures_.clear();
  why_not_connected_.clear();
  outgoing_.begin(event);
  log::info("broker_connected",
            {{"server", log_name()}, {"window", std::to_string(outgoing_.window())}});
  listener_.connection_began(event, now);
}

void Session::on(const ConnectFailed& event, SteadyTime now) {
  if (state_ != State::connecting) return;
  const bool is_logged = std::ranges::any_of(
      failures_, [&](const auto& failure) { return failure.second == event.text; });
  if (!is_logged) log::warn("broker_unreachable", {{"server", log_name()}, {"reason", event.text}});
  failures_[server()] = event.text;
  why_not_connected_ = event.text;
  state_ = State::waiting;
  starting_ = false;
  receive_maximum_ = kReceiveMaximum;
  listener_.attempt_failed();
  act_at_ = connects_.after_failure(now);
}

void Session::on(const Lost& event, SteadyTime now) {
  if (state_ == State::connecting) return on(ConnectFailed{event.text}, now);
  if (state_ != State::connected) return;
  log::warn("broker_lost", {{"server", log_name()}, {"reason", event.text}});
  why_not_connected_ = event.text;
  if (event.reason_code == kSessionTakenOver) listener_.session_taken_over();
  receive_maximum_ = kReceiveMaximum;
  end(now);
  act_at_ = connects_.after_loss(connected_at_, now);
}

void Session::on(const Disconnected&, SteadyTime now) {
  if (state_ == State::leaving) act_at_ = std::max(now, not_before_);
}

void Session::step(SteadyTime now) {
  if (state_ == State::connecting && now >= act_at_) {
    broker_.disconnect(will_);
    on(ConnectFailed{"no answer"}, now);
  }
  watch(now);
  if ((state_ == State::waiting || state_ == State::leaving) && now >= act_at_) connect(now);
}

void Session::connect(SteadyTime now) {
  state_ = State::connecting;
  act_at_ = now + connects_.patience();
  broker_.connect(connects_.index(), receive_maximum_);
}

void Session::end(SteadyTime now) {
  state_ = State::waiting;
  connects_.connection_ended(now);
  lost_at_ = now;
  down_since_.reset();
  outgoing_.forget();
  listener_.connection_ended(now);
}

void Session::reconnect_with_one_in_flight(SteadyTime now) {
  log::warn(
      "broker_sends_too_far_ahead",
      {{"server", server()},
       {"note",
        "PUBACKs arrive late, after messages; connecting again with Receive Maximum 1. The broker "
        "drops the commands that it has queued"}});
  receive_maximum_ = 1;
  broker_.disconnect(will_);
  broker_.hold_messages(true);  // unread messages end with the session
  end(now);
  state_ = State::leaving;
  act_at_ = now + kGoodbye;
}

void Session::restart(SteadyTime now) {
  const bool was_connected = state_ == State::connected;
  connects_.restart();
  failures_.clear();
  receive_maximum_ = kReceiveMaximum;
  if (was_connected) {
    broker_.disconnect(will_);
    end(now);
  }
  if (state_ == State::connecting) listener_.attempt_failed();
  // An attempt without an answer is not left: connect() abandons it.
  state_ = was_connected ? State::leaving : State::waiting;
  act_at_ = was_connected ? now + kGoodbye : now;
}

void Session::connect_to_next_server(SteadyTime now) {
  const SteadyTime next = connects_.after_failure(now);
  broker_.disconnect(will_);
  end(now);
  state_ = State::leaving;
  act_at_ = not_before_ = std::max(next, now + kGoodbye);
}

void Session::reconnect_if_leaving(SteadyTime now) {
  if (state_ == State::leaving) connect(now);
}

void Session::close(SteadyTime now) {
  if (state_ != State::connected) broker_.disconnect(will_);
  end(now);
}

/// Detects losses that the library does not report. Health is published at least every minute; if
/// the broker does not acknowledge it, the connection is lost.
void Session::watch(SteadyTime now) {
  const auto unanswered_since = outgoing_.unanswered_since();
  if (state_ == State::connected && unanswered_since &&
      now - *unanswered_since >= kNoAcknowledgement) {
    broker_.disconnect(Will::published);
    on(Lost{"no acknowledgement for 30 s"}, now);
  }
  if (state_ != State::connected) return down_since_.reset();
  // is_connected() takes a lock for which the library's threads wait, so it is called rarely.
  if (!down_since_ && now < check_at_) return;
  check_at_ = now + kBetweenChecks;
  if (broker_.is_connected()) return down_since_.reset();
  if (!down_since_) down_since_ = now;
  if (now - *down_since_ >= kLibraryForgot) on(Lost{"found closed"}, now);
}

SteadyTime Session::next_wake() const {
  if (state_ != State::connected) return act_at_;
  SteadyTime wake = SteadyTime::max();
  if (const auto since = outgoing_.unanswered_since()) wake = *since + kNoAcknowledgement;
  return down_since_ ? std::min(wake, *down_since_ + kLibraryForgot) : wake;
}

}  // namespace fxagent
