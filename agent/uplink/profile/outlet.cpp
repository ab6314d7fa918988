#include "agent/uplink/profile/outlet.h"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <set>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "agent/log/log.h"

namespace fxagent {
namespace {

constexpr std::size_t kMostResultBytes = std::size_t{4} << 20;  // that wait for the broker
constexpr std::chrono::seconds kSubackWithin{1};
constexpr int kSilenceIsSlow = 2;  // no answer counts as this many SUBSCRIBEs: the next waits 4 s
constexpr std::chrono::seconds kLastSubscribe{60};

}  // namespace

Outlet::Outlet(const Config& config, Settings settings, Profile& profile, Broker& broker,
               std::function<std::int64_t()> utc_ms, GuardedStore* store)
    : config_(config),
      settings_(std::move(settings)),
      profile_(profile),
      broker_(broker),
      utc_ms_(std::move(utc_ms)),
      store_(store),
      backoff_(settings_.jitter_seed),
      outgoing_(broker, settings_.marker_topic),
      session_(
          broker, outgoing_, settings_.mqtt, backoff_,
          {[this](const Connected& event, SteadyTime now) { connection_began(event, now); },
           [this](SteadyTime) { connection_ended(); }, [this] { samples_.spool_live(); }, [] {}},
          settings_.name, profile.wants_will_at_disconnect() ? Will::published : Will::discarded),
      samples_(config, settings_.boot, profile, outgoing_, backoff_, store,
               settings_.backlog_bytes),
      drops_(samples_.spool().waiting(), store, session_),
      farewell_(outgoing_, settings_.name, [this] { return profile_.farewell(utc_ms_()); }),
      shutdown_(session_, farewell_, std::chrono::seconds(1)) {
  profile_.begin(outgoing_, backoff_);
}

void Outlet::take(const Outbox::Batch& batch, SteadyTime now) {
  for (const DeviceStatus& status : batch.states) profile_.device_state(status);
  if (!profile_.wants_samples()) return;
  for (const auto& [device, count] : batch.dropped) collected_ += count;
  for (const Telemetry& sample : batch.telemetry) profile_.saw(sample, now);
  collected_ += batch.telemetry.size();
  const bool can_go =
      (session_.is_connected() || session_.is_starting()) && shutdown_.may_publish();
  samples_.take(batch, can_go, now);
}

void Outlet::change(const ConfigChange& change, SteadyTime now) {
  // The profile may have nothing for live samples of these; as history they are delivered or
  // counted.
  std::set<std::string> changed(change.devices_gone.begin(), change.devices_gone.end());
  for (const std::uint32_t i : change.devices_begin) changed.insert(config_.devices[i].name);
  samples_.make_history(changed);
  samples_.change(change);
  profile_.change(change);
  if (!change.mqtt || !settings_.mqtt_of) return;
  MqttConfig mqtt = settings_.mqtt_of(config_);
  if (mqtt == settings_.mqtt) return;
  if (session_.is_connected()) farewell_.say(now);
  settings_.mqtt = std::move(mqtt);
  broker_.use(settings_.mqtt);
  session_.settings_changed();
  if (!shutdown_.has_begun()) session_.restart(now);
}

SteadyTime Outlet::step(SteadyTime now) {
  if (finished()) return SteadyTime::max();
  take_broker_events(now);
  samples_.spool().waiting().upkeep(now, utc_ms_());
  if (store_ != nullptr) store_->take_found_late();
  samples_.spool().waiting().move_memory_to_disk();
  if (shutdown_.has_begun()) {
    for (const auto& [filter, reason] : std::exchange(ungranted_, {}))
      if (reason.empty())  // no answer is awaited any more
        profile_.subscribed({filter, false, "the agent is stopping"});
  } else {
    session_.step(now);
    subscribe(now);
    if (profile_.take_server_change() && session_.is_connected()) {
      farewell_.say(now);
      session_.connect_to_next_server(now);
    }
  }
  send(now);
  const bool failed = outgoing_.fail_unsendable(now);
  if (shutdown_.has_begun())
    shutdown_.step(
        !commands_wait_() && outgoing_.empty() && !samples_.has_live() && results_.empty(), now);
  if (finished()) {
    session_.close(now);
    samples_.spool().close();
    drops_.keep(now);
    return SteadyTime::max();
  }
  samples_.spool().commit(now, !shutdown_.has_begun());
  drops_.keep(now);
  broker_.await_acknowledgements(shutdown_.has_begun() || !session_.is_connected() ||
                                 samples_.history().is_on_the_way() ||
                                 outgoing_.size() >= outgoing_.window() / 2);
  return failed ? now : next_wake(now);
}

// ---- connection ---------------------------------------------------------------------------------

void Outlet::take_broker_events(SteadyTime now) {
  const auto take = [&](const auto& event) {
    using Event = std::remove_cvref_t<decltype(event)>;
    if constexpr (std::is_same_v<Event, Delivered> || std::is_same_v<Event, DeliveryFailed>) {
      outgoing_.on(event, now);
    } else if constexpr (std::is_same_v<Event, Message>) {
      profile_.hear(event);
    } else if constexpr (std::is_same_v<Event, MessagesDropped>) {
      log::error("messages_dropped",
                 {{"count", std::to_string(event.count)},
                  {"profile", settings_.name},
                  {"note", "more messages arrived than the agent can process"}});
    } else if constexpr (std::is_same_v<Event, Subscribed>) {
      subscribed(event);
    } else {
      session_.on(event, now);
      if constexpr (std::is_same_v<Event, Disconnected>) shutdown_.disconnected(now);
    }
  };
  for (const BrokerEvent& event : broker_.take_events()) std::visit(take, event);
}

/// Subscribes to all that the broker has not granted. Repeats that, because an access rule may be
/// mended while the session goes on.
void Outlet::subscribe(SteadyTime now) {
  if (ungranted_.empty() || now < subscribe_at_) return;
  for (Subscription& each : profile_.subscriptions()) {
    const auto found = ungranted_.find(each.filter);
    if (found == ungranted_.end()) continue;
    if (subscribes_ == 0 || !found->second.empty()) {
      broker_.subscribe(std::move(each));
    } else {
      subscribed({each.filter, false, "the broker does not confirm the subscription"});
      subscribes_ = std::max(subscribes_, kSilenceIsSlow);
    }
  }
  subscribe_at_ =
      now + (subscribes_ == 0 ? kSubackWithin : backoff_.after(subscribes_, kLastSubscribe));
  ++subscribes_;
}

void Outlet::subscribed(const Subscribed& event) {
  const auto found = ungranted_.find(event.filter);
  if (found == ungranted_.end()) return;
  profile_.subscribed(event);
  std::string& reason = found->second;
  if (event.granted) {
    if (!reason.empty())
      log::info("subscription_granted",
                {{"server", session_.log_name()}, {"filter", event.filter}});
    ungranted_.erase(found);
  } else if (reason.empty()) {
    reason = event.text;
    log::error("subscription_refused",
               {{"server", session_.log_name()},
                {"filter", event.filter},
                {"reason", reason},
                {"note", "the agent subscribes again; see the broker's log"}});
  }
}

void Outlet::connection_began(const Connected& connected, SteadyTime now) {
  samples_.connection_began();
  for (const Subscription& each : profile_.subscriptions()) ungranted_[each.filter];
  subscribes_ = 0;
  subscribe_at_ = now;
  if (!shutdown_.has_begun()) subscribe(now);
  profile_.connection_began(connected);
}

void Outlet::connection_ended() {
  samples_.connection_ended();
  ungranted_.clear();
  for (Result& each : results_) {
    each.flight = 0;
    each.not_before = {};
  }
  profile_.connection_ended();
}

// ---- sending ------------------------------------------------------------------------------------

void Outlet::send(SteadyTime now) {
  const bool running = !shutdown_.has_begun();
  samples_.settle(now, running);
  take_results(now);
  if (session_.is_connected() && shutdown_.may_publish()) {
    send_results(now);  // a thousand states may be due after a connect
    while (outgoing_.has_room()) {
      auto due = profile_.due(now, utc_ms_());
      if (due.empty()) break;
      outgoing_.send_group(*this, std::move(due));
    }
    const bool samples_go = profile_.wants_samples() && profile_.is_ready();
    if (samples_go) samples_.pump_live(now);
    send_results(now);
    if (samples_go && running) samples_.pump_history(true, now);
  }
  outgoing_.note_sent(now);
}

void Outlet::take_results(SteadyTime now) {
  if (results_.empty() && dropped_results_ != 0)
    log::warn("results_dropped", {{"profile", settings_.name},
                                  {"state", "over"},
                                  {"count", std::to_string(std::exchange(dropped_results_, 0))}});
  std::vector<Publication> fresh = profile_.take_results();
  if (fresh.empty()) return;
  for (Publication& each : fresh) results_.push_back({std::move(each), now});
  std::size_t bytes = 0;
  for (const Result& each : results_) bytes += each.publication.payload.size();
  for (; bytes > kMostResultBytes; results_.pop_front()) {
    bytes -= results_.front().publication.payload.size();
    if (++dropped_results_ == 1)
      log::error("results_dropped", {{"profile", settings_.name},
                                     {"note",
                                      "more than 4 MiB of results wait for this broker, so the "
                                      "oldest are dropped; the broker of mqtt gets all"}});
  }
}

/// Sends results in order. A result waits for live samples that were read before it, at most 1 s.
void Outlet::send_results(SteadyTime now) {
  for (Result& each : results_) {
    if (!outgoing_.has_room() || samples_.has_live_from(each.since)) return;
    if (each.flight == 0 && each.not_before <= now)
      each.flight = outgoing_.send(*this, each.publication);
  }
}

void Outlet::delivered(std::uint64_t id, SteadyTime) {
  std::erase_if(results_, [id](const Result& each) { return each.flight == id; });
}

void Outlet::failed(const DeliveryFailed& event, SteadyTime now) {
  log_failed(settings_.name, event);
  const auto result = std::ranges::find(results_, event.id, &Result::flight);
  if (result == results_.end()) return profile_.due_was_refused();
  if (is_final(event.reason_code)) {
    results_.erase(result);
    return;
  }
  result->flight = 0;
  result->not_before = now + backoff_.after(result->failures++);
}

void Outlet::stop(SteadyTime now) {
  if (shutdown_.has_begun()) return;
  shutdown_.begin(now);
  if (!session_.is_connected()) return;
  for (const Subscription& each : profile_.subscriptions()) broker_.unsubscribe(each.filter);
}

// ---- status -------------------------------------------------------------------------------------

SteadyTime Outlet::next_wake(SteadyTime now) const {
  SteadyTime wake = SteadyTime::max();
  const auto at = [&wake](SteadyTime time) { wake = std::min(wake, time); };
  if (shutdown_.has_begun())
    at(shutdown_.next_wake());
  else
    at(std::min(session_.next_wake(), ungranted_.empty() ? wake : subscribe_at_));
  at(samples_.next_wake(now));
  if (!session_.is_connected()) return wake;
  if (outgoing_.has_room() && shutdown_.may_publish()) {
    at(profile_.next_wake());
    for (const Result& each : results_)
      if (each.not_before > now) at(each.not_before);
  }
  if (profile_.is_ready()) at(samples_.history().next_wake(now));
  if (!outgoing_.empty()) at(now + Outgoing::kAcknowledgedWithin);
  return wake;
}

ProfileStatus Outlet::status() const {
  ProfileStatus status;
  status.name = settings_.name;
  status.server = session_.server();
  status.connected = session_.is_connected();
  status.ready = status.connected && profile_.is_ready();
  status.why = session_.why_not_connected();
  samples_.add_to(status.samples);
  status.samples.collected = collected_;
  return status;
}

}  // namespace fxagent
