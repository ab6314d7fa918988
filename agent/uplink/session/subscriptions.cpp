#include "agent/uplink/session/subscriptions.h"

#include <malloc.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "agent/log/log.h"

namespace fxagent {
namespace {

using std::chrono::seconds;

constexpr seconds kSubackWithin{1};  // before commands count as not received
constexpr seconds kCatchUp{1};       // between checks if enough results are delivered
constexpr int kSilenceIsSlow = 2;    // an unanswered SUBSCRIBE begins with this many failures: 4 s
constexpr seconds kLastSubscribe{60};  // also between subscriptions to what is not commands
constexpr seconds kLeftoversFor{10};   // search for topics of removed devices

}  // namespace

Subscriptions::Subscriptions(std::string base, Broker& broker, JitteredBackoff& backoff,
                             std::function<void()> changed)
    : base_(std::move(base)),
      commands_filter_(base_ + "/+/command"),
      configs_filter_(base_ + std::string(kDesiredTopic)),
      broker_(broker),
      backoff_(backoff),
      changed_(std::move(changed)) {}

void Subscriptions::connection_began(SteadyTime now) {
  is_connected_ = true;
  // Our own retained topics are what we search for, and another agent may have our client id; No
  // Local would hide both. Our own state is subscribed to before commands, so that another agent is
  // detected before commands arrive.
  broker_.subscribe({base_ + "/state", /*no_local=*/false});
  subscribe_to_commands(now);
  broker_.subscribe({base_ + "/+/state", /*no_local=*/false});
  broker_.subscribe({base_ + "/+/meta", /*no_local=*/false});
  if (hears_configs_) broker_.subscribe({configs_filter_, /*no_local=*/false});
  leftovers_until_ = now + kLeftoversFor;
}

void Subscriptions::connection_ended() {
  is_connected_ = false;
  leftovers_until_.reset();
  ask_refused_at_.reset();
  suback_by_.reset();
  ask_again_at_.reset();
  unheard_ = 0;
  if (!ended_) not_heard_why_.reset();
  paused_ = false;
}

SteadyTime Subscriptions::next_wake() const {
  SteadyTime wake = SteadyTime::max();
  for (const auto& time : {leftovers_until_, ask_refused_at_, suback_by_, ask_again_at_})
    wake = std::min(wake, time.value_or(wake));
  return wake;
}

void Subscriptions::end_commands() {
  ended_ = true;
  not_heard_why_ = "the agent is stopping";
  if (is_connected_) broker_.unsubscribe(commands_filter_);
}

void Subscriptions::hear_configs(bool heard) {
  if (heard == hears_configs_) return;
  hears_configs_ = heard;
  if (!is_connected_) return;  // takes effect with the next connection
  if (heard)
    broker_.subscribe({configs_filter_, /*no_local=*/false});
  else
    broker_.unsubscribe(configs_filter_);
}

void Subscriptions::on(const Subscribed& event, SteadyTime now) {
  if (!is_connected_) return;
  if (event.filter != commands_filter_) {
    if (event.granted) {
      if (refused_filters_.erase(event.filter) != 0)
        log::info("subscription_granted", {{"filter", event.filter}});
      return;
    }
    if (!ask_refused_at_) ask_refused_at_ = now + kLastSubscribe;
    if (refused_filters_.insert(event.filter).second)
      log::error("subscription_refused", {{"filter", event.filter}, {"reason", event.text}});
    return;
  }
  if (paused_ || ended_) return;  // answers a SUBSCRIBE that has been withdrawn since
  if (!event.granted) return unheard(event.text, now);
  suback_by_.reset();
  ask_again_at_.reset();
  unheard_ = 0;
  if (!not_heard_why_) return;
  not_heard_why_.reset();
  changed_();
  log::info("subscription_granted", {{"filter", event.filter}});
}

void Subscriptions::subscribe_to_commands(SteadyTime now) {
  ask_again_at_.reset();
  suback_by_ = now + kSubackWithin;
  broker_.subscribe({commands_filter_, /*no_local=*/true});
}

void Subscriptions::step(SteadyTime now, bool may_hear) {
  if (!is_connected_) return;
  if (leftovers_until_ && now >= *leftovers_until_) {
    leftovers_until_.reset();
    malloc_trim(0);  // return the memory of the initial burst to the system
  }
  if (ask_refused_at_ && now >= *ask_refused_at_) {
    ask_refused_at_.reset();
    for (const std::string& filter : refused_filters_)
      if (hears_configs_ || filter != configs_filter_)
        broker_.subscribe({filter, /*no_local=*/false});
  }
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

void Subscriptions::unheard(const std::string& reason, SteadyTime now) {
  suback_by_.reset();
  ask_again_at_ = now + backoff_.after(unheard_++, kLastSubscribe);
  if (not_heard_why_ == reason) return;  // log a repeated reason once
  not_heard_why_ = reason;
  changed_();
  log::error("subscription_refused", {{"filter", commands_filter_}, {"reason", reason}});
}

void Subscriptions::pause_commands(SteadyTime now) {
  paused_ = true;
  suback_by_.reset();
  ask_again_at_ = now + kCatchUp;
  not_heard_why_ = "more commands arrive than the agent can answer";
  changed_();
  broker_.unsubscribe(commands_filter_);
  log::error("commands_paused", {{"reason", *not_heard_why_}});
}

}  // namespace fxagent
