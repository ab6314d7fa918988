#include "agent/uplink/publisher.h"

#include <algorithm>
#include <chrono>
#include <type_traits>
#include <utility>
#include <variant>

#include "agent/commands/parse/parse.h"
#include "agent/commands/recovery.h"
#include "agent/commands/result.h"
#include "agent/log/log.h"

namespace fxagent {

Publisher::Publisher(Config& config, PublisherSettings settings, JsonPayload& payload,
                     Outbox& outbox, Broker& broker, Commands& commands, UtcClock utc_ms,
                     GuardedStore* store)
    : config_(config),
      settings_(std::move(settings)),
      payload_(payload),
      outbox_(outbox),
      broker_(broker),
      commands_(commands),
      utc_ms_(std::move(utc_ms)),
      store_(store),
      backoff_(settings_.jitter_seed),
      outgoing_(broker),
      subscriptions_(config.base_topic(), broker, backoff_,
                     [this] { retained_.agent_state_changed(); }),
      session_(broker, outgoing_, config.mqtt, backoff_,
               {[this](const Connected&, SteadyTime now) { connection_began(now); },
                [this](SteadyTime now) { connection_ended(now); },
                [this] { samples_.spool_live(); }, [this] { own_topics_.session_taken_over(); }}),
      states_(std::as_const(config).devices.size()),
      retained_(config, states_, payload, outgoing_, backoff_, "state",
                {[this] {
                   return payload_.agent_online(*started_ms_, subscriptions_.not_heard_why(),
                                                own_topics_.conflict());
                 },
                 [this](SteadyTime now) {
                   return retained(config_.base_topic() + "/health",
                                   json::health(*status_.at(now), config_));
                 }}),
      results_(config, commands.results(), outgoing_, backoff_, utc_ms_),
      samples_(config, settings_.boot, payload, outgoing_, backoff_, store,
               settings_.backlog_bytes),
      drops_(samples_.spool().waiting(), store, session_),
      intake_(commands, broker, config.mqtt),
      status_(
          {config, commands.results(), session_, subscriptions_, states_, retained_, results_,
           samples_, store, outlets_, settings_.boot, settings_.version},
          utc_ms_, [this] { outbox_.notify(); }, settings_.ask_counters),
      farewell_(outgoing_, "state",
                [this] { return std::vector{payload_.agent_offline(utc_ms_())}; }),
      shutdown_(session_, farewell_, std::chrono::seconds(3)),
      own_topics_({config, commands, session_, subscriptions_, shutdown_, farewell_, results_,
                   intake_, retained_, status_, store},
                  settings_.boot, settings_.is_ours) {
  subscriptions_.hear_configs(config.remote.enabled);
}

SteadyTime Publisher::step(SteadyTime now) {
  if (!started_ms_) {
    started_ms_ = utc_ms_();
    status_.start(now);
  }
  if (shutdown_.finished()) return keep_outlets(now);  // the profiles have not finished theirs
  take_broker_events(now);
  samples_.spool().waiting().upkeep(now, utc_ms_());
  take_found_late(now);  // older than all that follows
  samples_.spool().waiting().move_memory_to_disk();
  take_outbox(now);  // before commands: its results make room for them, its states set the model
  take_commands(now);
  // Their results are known; their commands are taken in the next step.
  const SteadyTime outlets_wake = keep_outlets(now);
  if (!shutdown_.has_begun()) keep_session(now);
  status_.report(now);
  send(now);
  press_back(now);  // by what has found no room
  const bool failed = outgoing_.fail_unsendable(now);
  if (shutdown_.has_begun()) keep_shutdown(now);
  samples_.spool().commit(now, !shutdown_.has_begun());
  drops_.keep(now);
  if (shutdown_.finished()) return outlets_wake;
  return failed ? now : std::min(outlets_wake, next_wake(now));
}

bool Publisher::finished() const {
  return shutdown_.finished() && std::ranges::all_of(outlets_, &Outlet::finished);
}

void Publisher::stop(SteadyTime now) {
  if (shutdown_.has_begun()) return;
  subscriptions_.end_commands();
  for (Outlet* outlet : outlets_) outlet->stop(now);
  shutdown_.begin(now);
  session_.reconnect_if_leaving(now);
  commands_.close();
}

// ---- events -------------------------------------------------------------------------------------

void Publisher::take_broker_events(SteadyTime now) {
  const auto take = [&](const auto& event) {
    using Event = std::remove_cvref_t<decltype(event)>;
    if constexpr (std::is_same_v<Event, Delivered> || std::is_same_v<Event, DeliveryFailed>)
      outgoing_.on(event, now);
    else if constexpr (std::is_same_v<Event, Message>)
      own_topics_.hear(event, now);
    else if constexpr (std::is_same_v<Event, MessagesDropped>)
      intake_.count_dropped(event.count);
    else if constexpr (std::is_same_v<Event, Subscribed>)
      subscriptions_.on(event, now);
    else
      session_.on(event, now);
    if constexpr (std::is_same_v<Event, Disconnected>) shutdown_.disconnected(now);
  };
  for (const BrokerEvent& event : broker_.take_events()) std::visit(take, event);
  own_topics_.follow_conflict(now);
  outbox_.set_conflict(own_topics_.conflict().has_value());
}

void Publisher::take_found_late(SteadyTime now) {
  auto late = store_ == nullptr || is_changing_ ? std::nullopt : store_->take_found_late();
  if (!late) return;
  Recovered known = recover(config_, store_->journal(), std::move(late->ids),
                            std::move(late->unacknowledged), utc_ms_(), now);
  commands_.restore(std::move(known), now, utc_ms_());
  std::vector<std::uint64_t> numbers;  // 0: not above this run's
  for (const DeviceConfig& device : std::as_const(config_).devices)
    numbers.push_back(late->numbers[device.name]);
  if (settings_.number_above) settings_.number_above(std::move(numbers));
}

void Publisher::take_outbox(SteadyTime now) {
  Outbox::Batch batch = outbox_.take();
  for (CommandResult& result : batch.results) {
    const bool may_have_written = result.attempts > 0 && result.op != to_string(Op::read);
    if (may_have_written) written_.insert(std::as_const(config_).devices.at(result.device).name);
    commands_.finish(std::move(result), utc_ms_());
  }
  for (Outlet* outlet : outlets_) outlet->take(batch, now);
  for (DeviceStatus& status : batch.states) {
    const std::uint32_t device = status.device;
    if (status.codec)
      commands_.set_codec(device, std::move(status.codec), std::move(status.codec_of_plc));
    states_.set(std::move(status));
    retained_.device_state_changed(device);
  }
  // Samples read while the first connection is being made are as live as those right after it.
  const bool can_go =
      (session_.is_connected() || session_.is_starting()) && shutdown_.may_publish();
  samples_.take(batch, can_go, now);
  status_.take(batch, now);
  for (const Outbox::Call& call : batch.calls) call(now);
}

SteadyTime Publisher::keep_outlets(SteadyTime now) {
  SteadyTime wake = SteadyTime::max();
  for (Outlet* outlet : outlets_) wake = std::min(wake, outlet->step(now));
  return wake;
}

void Publisher::recover_other_gateway(SteadyTime now) {
  for (Unanswered& each : std::exchange(unanswered_, {})) {
    if (store_ == nullptr || is_changing_) return;  // it asks again
    auto known = store_->journal().find(each.entry.device, each.entry.id);
    if (!store_->is_writable()) return;  // the journal may not have been read
    if (!known)
      commands_.restore(recover_unanswered(config_, store_->journal(), std::move(each.entry),
                                           each.topic, utc_ms_(), now),
                        now, utc_ms_());
    else if (known->acknowledged)
      each.published(std::move(*known));
  }
}

void Publisher::take_commands(SteadyTime now) {
  const std::int64_t utc_ms = utc_ms_();
  if (!is_changing_) commands_.recover_joined(now, utc_ms);
  recover_other_gateway(now);
  if (outbox_.refuses_commands()) commands_.close();
  intake_.take_some(now, utc_ms);
  for (ResultMessage& result : commands_.results().take()) results_.add(std::move(result), now);
}

void Publisher::take_relayed(RelayedCommand command, SteadyTime now) {
  if (command.received == SteadyTime{}) {
    command.received = now;
    command.received_ms = utc_ms_();
  }
  // The broker may be away for days: results must not fill the memory. Nor must relayed commands,
  // which other brokers send without our flow control.
  if (results_.is_full() || intake_.is_full()) {
    commands_.results().count(CommandStatus::rejected);
    if (!command.reply)
      return log::error("command_refused",
                        {{"device", command.device},
                         {"by", command.sender},
                         {"note", "too many commands and results wait; nothing was sent"}});
    Command refused = parse_command(command.payload);
    refused.received_ms = command.received_ms;
    CommandResult result = result_of(refused);
    set_outcome(result, CommandStatus::rejected, Reason::queue_full,
                "too many commands and results wait; nothing was sent");
    return command.reply(with_total(result_text(result), now - command.received));
  }
  Message message{std::move(static_cast<MessageProperties&>(command)),
                  config_.base_topic() + "/" + command.device + "/command",
                  std::move(command.payload)};
  intake_.add(std::move(message), std::move(command.device), false);
}

// ---- connection ---------------------------------------------------------------------------------

void Publisher::connection_began(SteadyTime now) {
  if (!shutdown_.has_begun()) subscriptions_.connection_began(now);
  retained_.connection_began();
  own_topics_.connection_began(now);
  status_.request_health(now);
  samples_.connection_began();
}

void Publisher::connection_ended(SteadyTime now) {
  subscriptions_.connection_ended();
  own_topics_.connection_ended(now);
  status_.connection_ended();
  samples_.connection_ended();
  retained_.connection_ended();  // all of it is published again after the next connect
  results_.connection_ended();
}

void Publisher::keep_session(SteadyTime now) {
  const bool runs_ahead = intake_.is_holding() && session_.receive_maximum() > 1 &&
                          config_.mqtt.version == 5 && session_.is_connected() &&
                          results_.is_far_behind(intake_.heard());
  if (runs_ahead) session_.reconnect_with_one_in_flight(now);
  if (farewell_.by() && (now >= *farewell_.by() || !session_.is_connected())) {
    farewell_.withdraw();
    session_.restart(now);
  }
  subscriptions_.step(now, results_.bytes() <= settings_.result_bytes / 2);
  session_.step(now);
}

void Publisher::press_back(SteadyTime now) {
  outbox_.set_backed_up(samples_.is_backed_up() || !session_.is_connected());
  intake_.hold({.is_on = session_.is_connected() && !shutdown_.has_begun(),
                .results_are_full = results_.is_full(),
                .awaits_suback = subscriptions_.awaits_suback(),
                .awaits_pubacks = !outgoing_.empty()},
               now);
  if (intake_.is_holding() && results_.bytes() >= settings_.result_bytes &&
      !subscriptions_.is_paused())
    subscriptions_.pause_commands(now);
  // An acknowledgement wakes this thread if something waits for it, or for the room that it makes.
  // Otherwise each one would wake it just to update a count.
  broker_.await_acknowledgements(shutdown_.has_begun() || !session_.is_connected() ||
                                 !results_.empty() || samples_.history().is_on_the_way() ||
                                 outgoing_.size() >= outgoing_.window() / 2);
}

// ---- sending ------------------------------------------------------------------------------------

void Publisher::send(SteadyTime now) {
  const bool running = !shutdown_.has_begun();
  samples_.settle(now, running);
  // A client that sees "online" may send a command at once. So nothing is published before commands
  // are received, or the state can report that they are not.
  const bool listens = !subscriptions_.awaits_first_suback() || !running;
  if (session_.is_connected() && shutdown_.may_publish() && listens) {
    if (std::exchange(samples_first_, false) || !written_.empty()) samples_.pump_live(now);
    // A sample read before a write is older than the write's result. If it finds no room before the
    // result, it becomes history.
    samples_.make_history(std::exchange(written_, {}));
    samples_first_ =
        results_.pump(now, intake_.is_holding() ? std::optional(intake_.heard()) : std::nullopt);
    if (!farewell_.by()) retained_.pump(now);
    samples_.pump_live(now);
    // Samples on disk are safe and do not delay the shutdown.
    if (running || store_ == nullptr) samples_.pump_history(running, now);
  }
  outgoing_.note_sent(now);
}

void Publisher::keep_shutdown(SteadyTime now) {
  shutdown_.step(intake_.empty() && outgoing_.empty() && results_.empty() && retained_.empty() &&
                     !samples_.has_live() && samples_.spool().empty(),
                 now);
  if (!shutdown_.finished()) return;
  session_.close(now);
  samples_.spool().close();
  log::info("uplink_stopped", {{"samples_left", std::to_string(samples().waiting())},
                               {"results_left", std::to_string(results_.size())}});
  if (const auto left = store_ == nullptr ? 0 : store_->journal().unrecorded(); left > 0)
    log::error(
        "commands_not_recorded",
        {{"count", std::to_string(left)},
         {"note",
          "the disk refused them: the audit does not have them all; fxagent.db.unrecorded keeps "
          "the last ids for the next start, unless the log has unrecorded_commands"}});
}

// ---- config change ------------------------------------------------------------------------------

std::optional<std::vector<std::uint64_t>> Publisher::change(const ConfigChange& change,
                                                            SteadyTime now) {
  is_changing_ = false;
  if (shutdown_.has_begun()) return std::nullopt;
  config_ = change.config;
  std::vector<std::string> begin;
  for (const std::uint32_t device : change.devices_begin)
    begin.push_back(change.config.devices[device].name);
  commands_.change(change, now);
  states_.change(change);
  retained_.change(change);
  samples_.change(change);
  for (Outlet* outlet : outlets_) outlet->change(change, now);
  status_.change(change);
  subscriptions_.hear_configs(config_.remote.enabled);
  if (change.mqtt) {
    broker_.use(config_.mqtt);
    session_.settings_changed();
    subscriptions_.forget_refusals();
    // Clients of a broker that we leave would otherwise see the agent online forever.
    if (session_.is_connected())
      farewell_.say(now);
    else
      session_.restart(now);
  }
  // Without a store, numbers start at the clock, as at the agent's start.
  const std::int64_t clock = utc_ms_();
  const auto last = store_ != nullptr ? store_->samples().join(begin, clock)
                                      : std::vector<std::uint64_t>(
                                            begin.size(), static_cast<std::uint64_t>(clock));
  std::vector<std::uint64_t> by_index(change.config.devices.size());
  for (std::size_t i = 0; i < begin.size(); ++i)
    by_index[change.devices_begin[i]] = std::max(last[i], settings_.first_seq);
  return by_index;
}

void Publisher::set_config_status(ConfigStatus status, SteadyTime now) {
  status_.set_config_status(std::move(status));
  if (session_.is_connected() && !shutdown_.has_begun()) status_.request_health(now);
}

// ---- wake-up ------------------------------------------------------------------------------------

SteadyTime Publisher::next_wake(SteadyTime now) const {
  SteadyTime wake = std::min(status_.next_wake(), intake_.next_wake(now));
  const auto at = [&wake](SteadyTime time) { wake = std::min(wake, time); };
  const bool running = !shutdown_.has_begun();
  if (running && farewell_.by()) at(*farewell_.by());
  at(running ? own_topics_.next_wake() : shutdown_.next_wake());
  if (running) at(session_.next_wake());
  at(samples_.next_wake(now));
  at(samples_.history().next_wake(now));
  if (!session_.is_connected()) return wake;
  if (running) at(subscriptions_.next_wake());
  // Messages that are due but have no room go out after the next acknowledgement, which is an
  // event.
  if (shutdown_.may_publish() && !farewell_.by()) at(retained_.next_wake(now));
  at(results_.next_wake(now));
  if (!outgoing_.empty()) at(now + Outgoing::kAcknowledgedWithin);
  return wake;
}

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
