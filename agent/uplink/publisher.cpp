#include "agent/uplink/publisher.h"

#include <algorithm>
#include <type_traits>
#include <utility>

#include "agent/commands/recovery.h"
#include "agent/log/log.h"
#include "agent/store/samples/first_numbers.h"
#include "agent/uplink/payload/json_payload.h"
#include "agent/uplink/puback.h"
#include "agent/uplink/topics.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr seconds kTick{60};                     // interval of health
constexpr milliseconds kAcknowledgedWithin{50};  // to process an acknowledgement on its own
constexpr seconds kCountersWithin{1};            // health goes out with older counters after this
constexpr seconds kDrainFor{3};
constexpr seconds kFarewellFor{1};

}  // namespace

Publisher::Publisher(Config& config, PublisherSettings settings, Payload& payload, Outbox& outbox,
                     Broker& broker, Commands& commands, UtcClock utc_ms, GuardedStore* store,
                     NumberAbove number_above, AskCounters ask_counters)
    : config_(config),
      settings_(std::move(settings)),
      base_(config.base_topic()),
      payload_(payload),
      outbox_(outbox),
      broker_(broker),
      commands_(commands),
      utc_ms_(std::move(utc_ms)),
      store_(store),
      number_above_(std::move(number_above)),
      ask_counters_(std::move(ask_counters)),
      backoff_(settings_.jitter_seed),
      outgoing_(broker),
      session_(config.mqtt, base_, broker, outgoing_, backoff_, *this),
      retained_(config, payload, outgoing_, backoff_,
                {[this] {
                   return payload_.agent_online(started_ms_, session_.not_heard_why(), conflict_);
                 },
                 [this](SteadyTime now) {
                   Publication publication;
                   publication.topic = base_ + "/health";
                   publication.payload = json::health(*status_.at(now), config_);
                   publication.retain = Retain::yes;
                   return publication;
                 },
                 [this] {
                   Publication publication;
                   publication.topic = base_ + std::string(kReportedTopic);
                   publication.payload = config_report_.value_or("");
                   if (publication.payload.empty()) config_report_.reset();  // cleared once
                   publication.retain = Retain::yes;
                   return publication;
                 }}),
      results_(config, commands, outgoing_, backoff_, utc_ms_),
      spool_(store, settings_.backlog_bytes),
      samples_out_(config, settings_.boot, payload, outgoing_, backoff_, spool_, store),
      intake_(commands, broker, config.mqtt),
      status_({config, commands, session_, retained_, spool_, results_, samples_out_, store},
              {settings_.boot, settings_.version}, utc_ms_, [this] { outbox_.notify(); }),
      identity_(settings_.boot) {
  session_.hear_configs(config.remote.enabled);
}

Publisher::~Publisher() = default;

SteadyTime Publisher::step(SteadyTime now) {
  if (!started_) start(now);
  take_broker_events(now);
  keep_store(now);   // what it recovers is older than all that follows
  take_outbox(now);  // before commands: its results make room for them, its states set the model
  take_commands(now);
  if (phase_ == Phase::running) keep_session(now);
  report(now);
  send(now);
  press_back(now);  // by what has found no room
  const bool failed = outgoing_.fail_unsendable(now);
  if (phase_ != Phase::running) wind_up(now);
  spool_.commit(now, phase_ == Phase::running);
  if (phase_ == Phase::finished) return SteadyTime::max();
  return failed ? now : next_wake(now);
}

void Publisher::start(SteadyTime now) {
  started_ = now;
  started_ms_ = utc_ms_();
  next_tick_ = now + kTick;
  status_.start(now);
}

void Publisher::take_broker_events(SteadyTime now) {
  for (BrokerEvent& event : broker_.take_events())
    std::visit([&](const auto& e) { on(e, now); }, event);
  follow_conflict(now);
}

void Publisher::keep_store(SteadyTime now) {
  if (store_ != nullptr) {
    store_->upkeep(now, utc_ms_());
    spool_.count_dropped();
  }
  take_found_late(now);
  spool_.move_memory_to_disk();
}

void Publisher::take_commands(SteadyTime now) {
  recover_joined(now);
  if (outbox_.refuses_commands()) commands_.close();
  intake_.take_some(now, utc_ms_());
  for (ResultMessage& result : commands_.take_results()) results_.add(std::move(result));
}

void Publisher::report(SteadyTime now) {
  if (now >= next_tick_) tick(now);
  status_.answer(now);
  if (!counters_by_ || now < *counters_by_) return;
  counters_by_.reset();
  retained_.health_is_due();
}

void Publisher::send(SteadyTime now) {
  samples_out_.settle(now);
  spool_.commit(now, phase_ == Phase::running);
  // A client that sees "online" may send a command at once. So nothing is published before commands
  // are received, or the state can report that they are not.
  const bool listens = !session_.awaits_first_suback() || phase_ != Phase::running;
  if (session_.is_connected() && phase_ <= Phase::draining && listens) pump(now);
  outgoing_.note_sent(now);
}

void Publisher::press_back(SteadyTime now) {
  outbox_.set_backed_up(samples_out_.is_backed_up());
  hold_messages(now);
  broker_.await_acknowledgements(acknowledgements_matter());
}

void Publisher::stop(SteadyTime now) {
  if (phase_ != Phase::running) return;
  phase_ = Phase::draining;
  phase_deadline_ = now + kDrainFor;
  goodbye_by_.reset();
  session_.begin_end(now);
  commands_.close();
}

// ---- broker events ------------------------------------------------------------------------------

void Publisher::on(const auto& event, SteadyTime now) {
  using Event = std::remove_cvref_t<decltype(event)>;
  if constexpr (std::is_same_v<Event, Delivered> || std::is_same_v<Event, DeliveryFailed>)
    outgoing_.on(event, now);
  else
    session_.on(event, now);
}

void Publisher::on(const Disconnected& event, SteadyTime now) {
  session_.on(event, now);
  if (phase_ == Phase::closing) phase_deadline_ = now;
}

void Publisher::on(const MessagesDropped& event, SteadyTime) { intake_.count_dropped(event.count); }

void Publisher::on(const Message& event, SteadyTime now) {
  intake_.hear(event);
  if (const auto name = device_of(event.topic, base_, "command")) return hear_command(event, *name);
  if (event.topic == base_ + std::string(kDesiredTopic)) {
    if (config_.remote.enabled && config_listener_.desired && phase_ == Phase::running)
      config_listener_.desired(event.payload);
    return;
  }
  // During shutdown the final state must stay as it is, and so must the offline state at a broker
  // that we leave for another one.
  if (phase_ == Phase::running && !goodbye_by_) hear_state(event, now);
}

void Publisher::hear_command(const Message& message, std::string_view name) {
  const bool is_known = commands_.device_named(name).has_value();
  if (!is_known) log::warn("command_for_unknown_device", {{"topic", log::excerpt(message.topic)}});
  if (is_known || may_be_a_device(name))
    intake_.add(message, std::string(name), results_.is_full());
}

void Publisher::hear_state(const Message& message, SteadyTime now) {
  if (message.topic == base_ + "/state") {
    identity_.heard(message.payload, now);
    return retained_.heard_agent_state(message.payload, now);
  }
  const auto of_state = device_of(message.topic, base_, "state");
  const auto name = of_state ? of_state : device_of(message.topic, base_, "meta");
  if (!name) return;
  if (const auto device = commands_.device_named(*name)) {
    if (conflict_) return;  // two agents would overwrite each other's states endlessly
    if (of_state)
      retained_.heard_device_state(*device, message.payload, now);
    else
      retained_.heard_device_meta(*device, message.payload, now);
  } else if (session_.looks_for_leftovers() && !message.payload.empty() &&
             retained_.clear(message.topic)) {
    log::info("retained_topic_cleared", {{"topic", log::excerpt(message.topic)}});
  }
}

void Publisher::follow_conflict(SteadyTime now) {
  if (phase_ != Phase::running) return;
  identity_.keep(now, intake_.is_holding());
  // MQTT 5 has a reason code for this; on 3.1.1 the broker acknowledges what it discards.
  if (identity_.take_unheard() && config_.mqtt.version == 4)
    log::warn(
        "own_state_not_heard",
        {{"topic", base_ + "/state"},
         {"note",
          "the broker acknowledges the agent's messages but does not send the agent's own state "
          "back. Its access rules may not include this agent's user, which MQTT 3.1.1 cannot "
          "report: all samples may be lost. fxagent acl prints the rules that the agent needs"}});
  const auto other = identity_.other();
  if (other == conflict_) return;
  const bool goes_on = other && conflict_ && *conflict_ != IdentityConflict::kUnknown;
  conflict_ = other;
  commands_.set_conflict(other.value_or(""));
  status_.set_conflict(other.value_or(""));
  // Our state reports a third agent when it is next restored. If each agent published it at once,
  // they would answer each other endlessly.
  if (goes_on) return;
  if (other)
    log::error("identity_conflict",
               {{"other_boot", *other},
                {"note",
                 "another agent has the same id: both refuse commands until one is gone; give each "
                 "agent its own agent.id and client_id"}});
  else
    log::info("identity_conflict", {{"state", "over"}});
  if (!session_.is_connected()) return;
  if (other)
    retained_.agent_state_changed();
  else
    retained_.everything_is_due();  // the other agent may have overwritten all of it
  make_health_due(now);
}

/// Publishes health with current counters, if the field answers in time.
void Publisher::make_health_due(SteadyTime now) {
  if (!ask_counters_) return retained_.health_is_due();
  if (counters_by_) return;
  counters_by_ = now + kCountersWithin;
  ask_counters_();
}

void Publisher::connection_began(SteadyTime now) {
  identity_.connection_began(session_.server(), now, session_.steady_after());
  retained_.connection_began();
  if (config_report_) retained_.config_report_is_due();
  if (config_listener_.connection) config_listener_.connection(true, now);
  make_health_due(now);
  samples_out_.connection_began();
}

void Publisher::connection_ended(SteadyTime now) {
  if (config_listener_.connection) config_listener_.connection(false, now);
  identity_.connection_ended();
  counters_by_.reset();
  samples_out_.connection_ended();
  retained_.connection_ended();  // all of it is published again after the next connect
  results_.connection_ended();
}

void Publisher::attempt_failed(SteadyTime) { samples_out_.spool_live(); }

void Publisher::subscription_changed() { retained_.agent_state_changed(); }

// ---- config change ------------------------------------------------------------------------------

std::optional<std::vector<std::uint64_t>> Publisher::change(const ConfigChange& change,
                                                            SteadyTime now) {
  changing_ = false;
  if (phase_ != Phase::running) return std::nullopt;
  std::set<std::string> gone;
  for (const std::uint32_t device : change.devices_end)
    gone.insert(std::as_const(config_).devices[device].name);
  config_ = change.config;
  std::vector<std::string> begin;
  for (const std::uint32_t device : change.devices_begin) {
    begin.push_back(change.config.devices[device].name);
    gone.erase(begin.back());
  }
  const auto joined = commands_.change(change, now);
  joined_.insert(joined_.end(), joined.begin(), joined.end());
  retained_.change(change, {gone.begin(), gone.end()}, session_.is_connected());
  samples_out_.change(change);
  status_.change(change);
  session_.hear_configs(config_.remote.enabled);
  if (change.mqtt) leave_old_settings(now);
  const auto last = numbers_to_join(begin, store_, utc_ms_());
  std::vector<std::uint64_t> by_index(change.config.devices.size());
  for (std::size_t i = 0; i < begin.size(); ++i) by_index[change.devices_begin[i]] = last[i];
  return by_index;
}

/// Recovers what earlier runs left of devices that were in no config of this run before.
void Publisher::recover_joined(SteadyTime now) {
  if (joined_.empty() || store_ == nullptr || store_->hangs()) return;
  Recovered known = recover_of(joined_, config_, *store_, utc_ms_(), now);
  if (store_->hangs()) return;  // the store was not read; try again
  joined_.clear();
  commands_.restore(std::move(known), now, utc_ms_());
}

/// Sets the state to offline at a broker that we leave for another one. Its clients would otherwise
/// see the agent online forever.
void Publisher::leave_old_settings(SteadyTime now) {
  broker_.use(config_.mqtt);
  session_.settings_changed();
  if (!session_.is_connected()) return session_.begin_anew(now);
  goodbye_by_ = now + kFarewellFor;
  outgoing_.send(*this, payload_.agent_offline(utc_ms_()));
}

void Publisher::set_config_status(ConfigStatus status, SteadyTime now) {
  status_.set_config_status(std::move(status));
  if (session_.is_connected() && phase_ == Phase::running) make_health_due(now);
}

void Publisher::report_config(std::string text, std::string audit) {
  config_report_ = std::move(text);
  if (session_.is_connected() && phase_ == Phase::running) retained_.config_report_is_due();
  if (!audit.empty() && store_ != nullptr) store_->note(std::move(audit));
}

// ---- field events -------------------------------------------------------------------------------

void Publisher::take_found_late(SteadyTime now) {
  // Not during a change: rows recovered for a device that ends would come too late.
  auto late = store_ == nullptr || changing_ ? std::nullopt : store_->take_found_late();
  if (!late) return;
  Recovered known = recover(config_, *store_, std::move(late->ids), std::move(late->unacknowledged),
                            utc_ms_(), now);
  commands_.restore(std::move(known), now, utc_ms_());
  if (number_above_) number_above_(later_numbers(config_, late->numbers));
}

void Publisher::take_outbox(SteadyTime now) {
  Outbox::Batch batch = outbox_.take();
  for (const auto& [device, count] : batch.dropped)
    spool_.drop(std::as_const(config_).devices.at(device).name, count);
  for (CommandResult& result : batch.results) {
    const bool may_have_written = result.attempts > 0 && result.op != to_string(Op::read);
    if (may_have_written) written_.insert(std::as_const(config_).devices.at(result.device).name);
    commands_.finish(std::move(result), utc_ms_());
  }
  for (DeviceStatus& status : batch.states) {
    const std::uint32_t device = status.device;
    if (status.codec) commands_.set_codec(device, std::move(status.codec));
    retained_.set(std::move(status));
    if (session_.is_connected()) retained_.device_state_changed(device);
  }
  // Samples read while the first connection is being made are as live as those right after it.
  const bool can_go =
      (session_.is_connected() || session_.is_starting()) && phase_ <= Phase::draining;
  samples_out_.take(batch.telemetry, can_go, now);
  const bool counted = batch.health.has_value();
  status_.take(batch, now);
  if (counted && std::exchange(counters_by_, std::nullopt)) retained_.health_is_due();
  for (const Outbox::Call& call : batch.calls) call(now);
}

// ---- connection ---------------------------------------------------------------------------------

void Publisher::keep_session(SteadyTime now) {
  const bool runs_ahead = intake_.is_holding() && session_.receive_maximum() > 1 &&
                          config_.mqtt.version == 5 && session_.is_connected() &&
                          results_.is_far_behind(intake_.heard());
  if (runs_ahead) session_.connect_anew(now);
  if (goodbye_by_ && (now >= *goodbye_by_ || !session_.is_connected())) {
    goodbye_by_.reset();
    session_.begin_anew(now);
  }
  session_.keep(now, results_.bytes() <= settings_.result_bytes / 2);
}

void Publisher::hold_messages(SteadyTime now) {
  CommandIntake::Pressure pressure;
  pressure.is_on = session_.is_connected() && phase_ == Phase::running;
  pressure.results_are_full = results_.is_full();
  pressure.awaits_suback = session_.awaits_suback();
  pressure.awaits_pubacks = !outgoing_.empty();
  intake_.hold(pressure, now);
  if (intake_.is_holding() && results_.bytes() >= settings_.result_bytes && !session_.is_paused())
    session_.pause_commands(now);
}

void Publisher::tick(SteadyTime now) {
  next_tick_ = now + kTick;
  status_.tick(now);
  if (session_.is_connected()) make_health_due(now);
}

// ---- sending ------------------------------------------------------------------------------------

void Publisher::pump(SteadyTime now) {
  if (std::exchange(samples_first_, false) || !written_.empty()) samples_out_.pump_live(now);
  // A sample read before a write is older than the write's result. If it finds no room before the
  // result, it becomes history.
  samples_out_.make_history(std::exchange(written_, {}));
  samples_first_ =
      results_.pump(now, intake_.is_holding() ? std::optional(intake_.heard()) : std::nullopt);
  if (!goodbye_by_) retained_.pump(now);
  samples_out_.pump_live(now);
  // Samples on disk are safe and do not delay the shutdown.
  const bool running = phase_ == Phase::running;
  if (running || store_ == nullptr) samples_out_.pump_history(running, now);
}

// ---- shutdown -----------------------------------------------------------------------------------

void Publisher::wind_up(SteadyTime now) {
  const bool over = now >= phase_deadline_ || session_.is_waiting();
  switch (phase_) {
    case Phase::running:
    case Phase::finished:
      return;
    case Phase::draining:
      if (session_.is_connected() && (over || drained())) {
        phase_ = Phase::farewell;
        phase_deadline_ = now + kFarewellFor;
        outgoing_.send(*this, payload_.agent_offline(utc_ms_()));
        return;
      }
      if (over) finish(now);
      return;
    case Phase::farewell:
      if (!over) return;
      phase_ = Phase::closing;
      phase_deadline_ = now + kFarewellFor;
      return broker_.disconnect();
    case Phase::closing:
      if (over) finish(now);
      return;
  }
}

/// Ends the shutdown. What the broker has not acknowledged is left for the next boot.
void Publisher::finish(SteadyTime now) {
  phase_ = Phase::finished;
  session_.give_up(now);
  if (store_ != nullptr) {
    spool_.move_memory_to_disk();
    spool_.write();
    store_->close();
  }
  const SampleCounts left = samples();
  log::info("uplink_stopped",
            {{"samples_left", std::to_string(left.queued + left.in_flight + left.stored)},
             {"results_left", std::to_string(results_.size())}});
}

void Publisher::delivered(std::uint64_t, SteadyTime now) {
  if (phase_ == Phase::farewell) phase_deadline_ = now;
  if (goodbye_by_) goodbye_by_ = now;
}

void Publisher::failed(const DeliveryFailed& event, SteadyTime now) { delivered(event.id, now); }

bool Publisher::drained() const {
  return intake_.empty() && outgoing_.empty() && results_.empty() && retained_.empty() &&
         !samples_out_.has_live() && spool_.empty();
}

// ---- wake-up ------------------------------------------------------------------------------------

/// True if something waits for an acknowledgement, or for the room that it makes. Otherwise each
/// acknowledgement would wake this thread just to update a count.
bool Publisher::acknowledgements_matter() const {
  return phase_ != Phase::running || !session_.is_connected() || !results_.empty() ||
         samples_out_.has_history_on_the_way() || outgoing_.size() >= outgoing_.window() / 2;
}

SteadyTime Publisher::next_wake(SteadyTime now) const {
  SteadyTime wake = std::min(next_tick_, intake_.next_wake(now));
  const auto at = [&wake](SteadyTime time) { wake = std::min(wake, time); };
  if (counters_by_) at(*counters_by_);
  if (goodbye_by_) at(*goodbye_by_);
  at(phase_ == Phase::running ? identity_.next_wake() : phase_deadline_);
  if (phase_ == Phase::running || !session_.is_connected()) at(session_.next_wake());
  if (spool_.gathered() != 0) at(spool_.commit_at());
  if (store_ != nullptr && store_->has_pending()) at(now + SampleSpool::kCommitWithin);
  at(samples_out_.next_wake(now));
  if (!session_.is_connected()) return wake;
  // Messages that are due but have no room go out after the next acknowledgement, which is an
  // event.
  at(retained_.next_wake(now));
  at(results_.next_wake(now));
  if (!outgoing_.empty()) at(now + kAcknowledgedWithin);
  return wake;
}

SampleCounts Publisher::samples() const { return status_.samples(); }

void run_uplink(Publisher& publisher, Outbox& outbox, std::stop_token stop,
                const std::function<void()>& stepped) {
  const std::stop_callback wake(stop, [&outbox] { outbox.notify(); });
  while (!publisher.finished()) {
    const SteadyTime now = std::chrono::steady_clock::now();
    if (stop.stop_requested()) publisher.stop(now);
    const SteadyTime wake_at = publisher.step(now);
    if (stepped) stepped();
    if (publisher.finished()) return;
    if (publisher.gather_until() > now) outbox.gather(publisher.gather_until());
    outbox.wait_until(wake_at);
  }
}

}  // namespace fxagent
