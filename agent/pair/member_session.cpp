#include "agent/pair/member_session.h"

#include <algorithm>
#include <chrono>
#include <string_view>
#include <utility>
#include <variant>

#include "agent/log/log.h"
#include "agent/uplink/topics.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kReconnect{500};
constexpr seconds kLongestPause{60};
constexpr int kMostDoublings = 6;
constexpr seconds kSubackWithin{5};  // before SUBSCRIBE is repeated; doubled each time
constexpr seconds kSteady{10};       // a session that lasts so long is not being taken over
constexpr const char* kNotKnown =
    "commands that the other gateway announced before are not known here; repeat none of them "
    "after a takeover";

/// Returns `first`, doubled so many times.
BootTime doubled(BootTime first, int times) {
  return std::min<BootTime>(first * (1 << std::min(times, kMostDoublings)), kLongestPause);
}

}  // namespace

MemberSession::MemberSession(std::unique_ptr<Broker> broker, std::size_t servers,
                             const std::string& base, PairPeers& peers)
    : broker_(std::move(broker)), failures_(servers), peers_(peers) {
  for (const std::string_view topic : kPairTopics)
    filters_.push_back(base + "/" + std::string(topic));
}

void MemberSession::keep(BootTime now) {
  if (connect_at_ && now >= *connect_at_) {
    connect_at_.reset();
    broker_->connect(server_, kReceiveMaximum);
  }
  if (up_ && !unheard_.empty() && now >= subscribe_at_) {
    if (repeats_++ == 0 && refused_.empty())
      log::error("pair", {{"fault", "the broker does not confirm the subscriptions of the pair"}});
    subscribe(now);
  }
}

void MemberSession::take_events(BootTime now, const std::function<void(const BrokerEvent&)>& rest) {
  for (const BrokerEvent& event : broker_->take_events()) {
    if (const auto* begun = std::get_if<Connected>(&event)) connected(*begun, now);
    if (const auto* answer = std::get_if<Subscribed>(&event)) subscribed(*answer, now);
    if (const auto* failure = std::get_if<ConnectFailed>(&event)) {
      log_once(failure->text);
      connect_after(kReconnect, now);
    }
    if (const auto* end = std::get_if<Lost>(&event)) lost(*end, now);
    rest(event);
  }
}

void MemberSession::connected(const Connected& event, BootTime now) {
  up_ = true;
  up_since_ = now;
  std::ranges::fill(failures_, "");
  heard_all_ = heard_all_ && event.session_present;
  missed_ = missed_ || !event.session_present;
  unheard_.insert(filters_.begin(), filters_.end());
  refused_.clear();
  repeats_ = 0;
  subscribe(now);
}

void MemberSession::subscribed(const Subscribed& event, BootTime now) {
  if (event.granted) {
    if (unheard_.erase(event.filter) == 0 || !unheard_.empty()) return;
    if (std::exchange(missed_, false)) log::warn("pair", {{"session", "new"}, {"note", kNotKnown}});
    return peers_.joined(now);
  }
  heard_all_ = false;
  missed_ = true;
  subscribe_at_ = now + doubled(seconds(1), repeats_);
  if (refused_.insert(event.filter).second)
    log::error("pair", {{"fault", "the broker refuses the subscription to " + event.filter +
                                      "; see fxagent acl"}});
}

void MemberSession::lost(const Lost& event, BootTime now) {
  const bool taken_over = event.reason_code == kSessionTakenOver;
  thrown_ = taken_over || now - up_since_ < kSteady ? thrown_ + 1 : 0;
  peers_.left(taken_over);
  connect_after(doubled((taken_over ? BootTime(seconds(1)) : BootTime(kReconnect)) / 2, thrown_),
                now);
}

/// Logs a failure to connect, unless the last one of this or another server was the same.
void MemberSession::log_once(const std::string& failure) {
  if (std::ranges::find(failures_, failure) == failures_.end())
    log::warn("pair", {{"broker", "unreachable"}, {"reason", failure}});
  failures_[server_] = failure;
}

void MemberSession::connect_after(BootTime pause, BootTime now) {
  up_ = false;
  server_ = (server_ + 1) % failures_.size();
  connect_at_ = now + pause;
}

/// Subscribes to what the broker has not granted. With QoS 0 it queues nothing while this session
/// is away. Queued statuses would name gateways that have ended.
void MemberSession::subscribe(BootTime now) {
  subscribe_at_ = now + doubled(kSubackWithin, repeats_);
  for (const std::string& filter : filters_) {
    const bool queues = filter.ends_with("/journal") || filter.ends_with("/result");
    if (unheard_.contains(filter)) broker_->subscribe({.filter = filter, .qos = queues ? 1 : 0});
  }
}

}  // namespace fxagent
