#include "agent/uplink/publisher.h"

#include <malloc.h>

#include <algorithm>
#include <type_traits>

#include "agent/commands/recovery.h"
#include "agent/log/log.h"
#include "agent/process/process_facts.h"
#include "agent/store/first_numbers.h"
#include "agent/uplink/puback.h"
#include "agent/uplink/topics.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr seconds kTick{60};        // health
constexpr seconds kCleanUpFor{10};  // how long retained topics of unknown devices are looked for
constexpr seconds kConnectPatience{30};          // longer than the library's own connect time-out
constexpr milliseconds kAcknowledgedWithin{50};  // until one that nothing waits for is noted
constexpr seconds kDrainFor{3};
constexpr seconds kFarewellFor{1};

// Mosquitto's default receive maximum. The library under us is fast up to the broker's figure and
// very slow beyond it.
constexpr std::size_t kMaxWindow = 20;
// Until it is asked again whether messages are still to be held back.
constexpr milliseconds kHoldAtMost{1};
// So many samples behind a full window tell that the broker takes fewer than are made.
constexpr std::size_t kBackedUp = 4;
// A quarter of what is allowed: one of 64 KiB holds a live sample up for milliseconds.
constexpr std::size_t kHistoryBytes = 16384;
// What a PUBLISH needs beside topic, payload and correlation data: header, lengths, packet id.
constexpr std::size_t kPacketOverhead = 64;

}  // namespace

Publisher::Publisher(const Config& config, PublisherSettings settings, Outbox& outbox,
                     Broker& broker, Submit submit, UtcClock utc_ms, Store* store, GoAhead go_ahead,
                     Restore restore)
    : config_(config),
      settings_(std::move(settings)),
      base_(config.base_topic()),
      outbox_(outbox),
      broker_(broker),
      submit_(std::move(submit)),
      utc_ms_(std::move(utc_ms)),
      store_(store),
      go_ahead_(std::move(go_ahead)),
      restore_(std::move(restore)),
      jitter_(settings_.jitter_seed),
      backlog_(settings_.backlog_bytes),
      history_bytes_(kHistoryBytes),
      states_(config.devices.size()) {
  for (const DeviceConfig& device : config.devices)
    meta_hashes_.push_back(json::device_meta(device).hash);
}

Publisher::~Publisher() = default;

SteadyTime Publisher::step(SteadyTime now) {
  if (!started_) {
    started_ = now;
    started_ms_ = utc_ms_();
    last_tick_ = now;
    next_tick_ = now + kTick;
  }
  for (BrokerEvent& event : broker_.take_events()) std::visit([&](auto& e) { on(e, now); }, event);
  take_incoming();
  if (store_ != nullptr) {
    store_->upkeep(now, utc_ms_());
    count_dropped();
  }
  take_found_late(now);
  move_memory_to_disk();
  take_outbox(now);
  record_results();
  keep_connected(now);
  if (now >= next_tick_) tick(now);
  overflow(now);
  hold_on_disk(now);
  commit_spool(now);
  // Whoever sees "online" and sends a command at once is heard, or is told that nobody listens.
  const bool listens = !awaits_first_suback() || phase_ != Phase::running;
  if (link_ == Link::connected && phase_ <= Phase::draining && listens) pump(now);
  if (std::exchange(handed_over_, false) && !unacknowledged_since_) unacknowledged_since_ = now;
  outbox_.set_backed_up(live_.size() >= kBackedUp);
  take_decided();
  hold_messages(now);
  broker_.await_acknowledgements(acknowledgements_matter());
  const auto failures = std::exchange(unsendable_, {});
  for (const DeliveryFailed& failure : failures) {
    auto flight = flights_.extract(failure.id);
    std::visit([&](auto& f) { failed(f, failure, now); }, flight.mapped());
  }
  if (phase_ != Phase::running) wind_up(now);
  commit_spool(now);
  if (phase_ == Phase::finished) return SteadyTime::max();
  return failures.empty() ? next_wake(now) : now;
}

void Publisher::stop(SteadyTime now) {
  if (phase_ != Phase::running) return;
  phase_ = Phase::draining;
  phase_deadline_ = now + kDrainFor;
  if (link_ == Link::connected) broker_.unsubscribe(base_ + "/+/command");
  if (link_ == Link::leaving) connect(now);  // who was told goodbye is to hear the last word too
  take_outbox(now);  // commands and results that came before any further command
  record_results();
}

// ---- what the broker says -----------------------------------------------------------------------

void Publisher::on(const Connected& event, SteadyTime now) {
  if (link_ != Link::connecting) return;
  link_ = Link::connected;
  starting_ = false;
  connected_at_ = now;
  last_up_ = now;
  failed_rounds_ = 0;
  last_failure_.clear();
  window_ = std::clamp<std::size_t>(event.receive_maximum, 1, kMaxWindow);
  max_packet_ = event.maximum_packet;
  history_bytes_ = kHistoryBytes;
  log::info("broker_connected",
            {{"server", config_.mqtt.servers.at(server_)}, {"window", std::to_string(window_)}});
  subscribe_to_commands(now);
  // Our own retained topics are what is looked for here, so No Local would hide them.
  broker_.subscribe({base_ + "/+/state", /*no_local=*/false});
  broker_.subscribe({base_ + "/+/meta", /*no_local=*/false});
  clean_up_until_ = now + kCleanUpFor;

  due_.clear();
  due_[{Notice::agent_state, 0, {}}];
  due_[{Notice::health, 0, {}}];
  for (std::uint32_t device = 0; device < config_.devices.size(); ++device) {
    due_[{Notice::device_meta, device, {}}];
    if (states_[device]) due_[{Notice::device_state, device, {}}];
  }
  pauses_.clear();
}

void Publisher::on(const ConnectFailed& event, SteadyTime now) {
  if (link_ != Link::connecting) return;
  if (event.text != last_failure_) {  // a repeated one is not news
    log::warn("broker_unreachable",
              {{"server", config_.mqtt.servers.at(server_)}, {"reason", event.text}});
    last_failure_ = event.text;
  }
  link_ = Link::waiting;
  starting_ = false;
  receive_maximum_ = kReceiveMaximum;
  spool_live();
  retry_after_failure(now);
}

void Publisher::on(const Lost& event, SteadyTime now) {
  if (link_ == Link::connecting) return on(ConnectFailed{event.text}, now);
  if (link_ != Link::connected) return;
  log::warn("broker_lost", {{"server", config_.mqtt.servers.at(server_)}, {"reason", event.text}});
  receive_maximum_ = kReceiveMaximum;
  connection_over(now);
  retry_after_loss(now);
}

void Publisher::on(const Disconnected&, SteadyTime now) {
  if (link_ == Link::leaving) retry_at_ = now;
  if (phase_ == Phase::closing) phase_deadline_ = now;
}

void Publisher::on(const Message& event, SteadyTime) {
  if (event.qos != 0) {  // those of QoS 0 come without asking
    ++heard_.messages;
    heard_.bytes += bytes_of(event);
  }
  const auto index_of = [this](std::string_view name) {
    const auto found = std::find_if(config_.devices.begin(), config_.devices.end(),
                                    [name](const auto& device) { return device.name == name; });
    return static_cast<std::uint32_t>(found - config_.devices.begin());
  };
  if (const auto name = device_of(event.topic, base_, "command")) {
    const std::uint32_t device = index_of(*name);
    if (device < config_.devices.size())
      note_incoming(event, device);
    else
      log::warn("command_ignored",
                {{"topic", log::excerpt(event.topic)}, {"reason", "no such device"}});
    return;
  }
  auto name = device_of(event.topic, base_, "state");
  if (!name) name = device_of(event.topic, base_, "meta");
  if (name && !event.payload.empty() && index_of(*name) == config_.devices.size() &&
      due_.try_emplace({Notice::clear, 0, event.topic}).second)
    log::info("retained_topic_cleared", {{"topic", log::excerpt(event.topic)}});
}

void Publisher::on(const Delivered& event, SteadyTime now) {
  auto flight = flights_.extract(event.id);
  if (flight.empty()) return;  // of a connection that is gone
  note_acknowledgement(flight.mapped(), now);
  std::visit([&](const auto& f) { delivered(f, now); }, flight.mapped());
}

void Publisher::on(const DeliveryFailed& event, SteadyTime now) {
  auto flight = flights_.extract(event.id);
  if (flight.empty()) return;
  if (event.reason_code != 0) note_acknowledgement(flight.mapped(), now);
  std::visit([&](auto& f) { failed(f, event, now); }, flight.mapped());
}

void Publisher::on(const MessagesDropped& event, SteadyTime) { unasked_dropped_ += event.count; }

void Publisher::delivered(const NoticeFlight&, SteadyTime) {}

void Publisher::delivered(const FarewellFlight&, SteadyTime now) { phase_deadline_ = now; }

void Publisher::failed(const NoticeFlight& flight, const DeliveryFailed& event, SteadyTime now) {
  log::warn("publish_refused",
            {{"what", "state"}, {"code", hex_code(event.reason_code)}, {"reason", event.text}});
  if (is_final(event.reason_code)) return;
  due_.insert_or_assign(flight.key, Due{now + back_off(flight.failures), flight.failures + 1});
}

void Publisher::failed(const FarewellFlight&, const DeliveryFailed&, SteadyTime now) {
  phase_deadline_ = now;
}

// ---- what the field says ------------------------------------------------------------------------

void Publisher::take_found_late(SteadyTime now) {
  auto late = store_ == nullptr ? std::nullopt : store_->take_found_late();
  if (!late) return;
  Recovered known = recover(config_, store_->journal(), std::move(late->ids),
                            std::move(late->unacknowledged), utc_ms_(), now);
  known.field.last_seq = later_numbers(config_, late->numbers);
  for (CommandResult& result : known.unacknowledged) {
    result.received = now;
    take_result(std::move(result));
  }
  if (restore_) restore_(std::move(known.field));
}

void Publisher::take_outbox(SteadyTime now) {
  Outbox::Batch batch = outbox_.take();
  take_admitted(std::move(batch.notes));  // first: each waits for its go-ahead
  pushed_ = batch.pushed;
  for (const auto& [device, count] : batch.dropped) drop(config_.devices.at(device).name, count);
  for (CommandResult& result : batch.results) take_result(std::move(result));
  for (DeviceStatus& status : batch.states) {
    const std::uint32_t device = status.device;
    states_.at(device) = std::move(status);
    if (link_ == Link::connected) due_[{Notice::device_state, device, {}}] = {};
  }
  take_samples(batch.telemetry, now);
  if (batch.health) {
    field_ = std::move(*batch.health);
    std::uint64_t sent = 0;
    for (const DeviceHealth& device : field_.devices) sent += device.collected - device.suppressed;
    miscounted_ = sent != batch.pushed_at_health;
    if (miscounted_)
      log::error("samples_miscounted", {{"field", std::to_string(sent)},
                                        {"outbox", std::to_string(batch.pushed_at_health)}});
  }
}

// ---- the connection -----------------------------------------------------------------------------

void Publisher::keep_connected(SteadyTime now) {
  if (phase_ != Phase::running) return;
  if (link_ == Link::connecting && now >= connect_deadline_) {
    broker_.disconnect();
    on(ConnectFailed{"no answer"}, now);
  }
  watch_connection(now);
  keep_subscribed(now);
  if ((link_ == Link::waiting || link_ == Link::leaving) && now >= retry_at_) connect(now);
  if (link_ == Link::connected && clean_up_until_ && now >= *clean_up_until_) {
    clean_up_until_.reset();
    broker_.unsubscribe(base_ + "/+/state");
    broker_.unsubscribe(base_ + "/+/meta");
    malloc_trim(0);  // what the flood of a new connection took goes back, for the years that follow
  }
}

void Publisher::connect(SteadyTime now) {
  link_ = Link::connecting;
  connect_deadline_ = now + kConnectPatience;
  broker_.connect(server_, receive_maximum_);
}

void Publisher::connection_over(SteadyTime now) {
  link_ = Link::waiting;
  last_up_ = now;
  clean_up_until_.reset();
  unacknowledged_since_.reset();
  down_since_.reset();
  suback_by_.reset();
  ask_again_at_.reset();
  unheard_ = 0;
  deaf_.reset();
  paused_ = false;
  auto flights = std::exchange(flights_, {});
  history_flights_ = 0;
  in_flight_samples_ = 0;
  for (auto& [id, flight] : flights) {
    if (auto* live = std::get_if<LiveFlight>(&flight))
      spool(std::move(live->live));
    else if (const auto* history = std::get_if<HistoryFlight>(&flight))
      history->on_disk ? store_->samples().returned(history->batch)
                       : backlog_.returned(history->batch);
  }
  spool_live();
  due_.clear();  // all of it is published again after the next connect
  refused_results_.clear();
  for (auto& [key, pending] : results_) {
    for (PendingResult::Copy& copy : pending.copies) {
      copy.in_flight = false;
      copy.due = {};
    }
  }
}

void Publisher::tick(SteadyTime now) {
  const double hours = std::chrono::duration<double, std::ratio<3600>>(now - last_tick_).count();
  bytes_per_hour_ = static_cast<double>(std::exchange(row_bytes_, 0)) / hours;
  last_tick_ = now;
  next_tick_ = now + kTick;
  if (dropped_total_ != dropped_at_tick_) {
    log::warn("samples_dropped", {{"count", std::to_string(dropped_total_ - dropped_at_tick_)},
                                  {"total", std::to_string(dropped_total_)}});
    dropped_at_tick_ = dropped_total_;
  }
  const json::Samples now_here = samples();
  if (!now_here.balanced())
    log::error("samples_unbalanced", {{"collected", std::to_string(now_here.collected)},
                                      {"recovered", std::to_string(now_here.recovered)},
                                      {"suppressed", std::to_string(now_here.suppressed)},
                                      {"queued", std::to_string(now_here.queued)},
                                      {"in_flight", std::to_string(now_here.in_flight)},
                                      {"stored", std::to_string(now_here.stored)},
                                      {"acknowledged", std::to_string(now_here.acknowledged)},
                                      {"dropped", std::to_string(now_here.dropped)}});
  if (link_ == Link::connected) due_[{Notice::health, 0, {}}];
}

// ---- what goes out ------------------------------------------------------------------------------

void Publisher::pump(SteadyTime now) {
  const bool samples_first = std::exchange(samples_first_, false);
  if (samples_first) pump_live(now);
  pump_results(now);
  pump_notices(now);
  pump_live(now);
  // What is on disk is safe there and does not hold up the end.
  if (phase_ == Phase::running || store_ == nullptr) pump_history(now);
}

void Publisher::pump_notices(SteadyTime now) {
  for (auto next = due_.begin(); next != due_.end() && has_room();) {
    const auto current = next++;
    if (current->second.not_before > now) continue;
    const auto taken = due_.extract(current);
    const NoticeKey& key = taken.key();
    Publication publication;
    publication.retain = Retain::yes;
    switch (key.notice) {
      case Notice::agent_state:
        publication.topic = base_ + "/state";
        publication.payload =
            json::agent_online(started_ms_, settings_.boot, settings_.version, deaf_);
        break;
      case Notice::device_state:
        publication.topic = device_topic(key.device) + "/state";
        publication.payload = json::device_state(*states_[key.device]);
        break;
      case Notice::device_meta:
        publication.topic = device_topic(key.device) + "/meta";
        publication.payload = json::device_meta(config_.devices[key.device]).text;
        break;
      case Notice::health:
        publication.topic = base_ + "/health";
        publication.payload = health_text(now);
        break;
      case Notice::clear:
        publication.topic = key.topic;
        break;
    }
    send(NoticeFlight{key, taken.mapped().failures}, std::move(publication));
  }
}

void Publisher::send(Flight flight, Publication publication) {
  publication.id = next_id_++;
  flights_.emplace(publication.id, std::move(flight));
  // Either of these would make the broker close the connection, again and again.
  if (!is_publishable(publication.topic))
    unsendable_.push_back(
        {publication.id, kTopicNameInvalid, "not a topic: " + log::excerpt(publication.topic)});
  else if (!fits(publication))
    unsendable_.push_back({publication.id, kPacketTooLarge, "larger than the broker takes"});
  else {
    handed_over_ = true;
    broker_.publish(std::move(publication));
  }
}

/// Whether the broker takes a packet of that size.
bool Publisher::fits(const Publication& publication) const {
  return publication.topic.size() + publication.payload.size() + publication.correlation.size() +
             kPacketOverhead <=
         max_packet_;
}

// ---- the end ------------------------------------------------------------------------------------

void Publisher::wind_up(SteadyTime now) {
  const bool over = now >= phase_deadline_ || link_ == Link::waiting;
  switch (phase_) {
    case Phase::running:
    case Phase::finished:
      return;
    case Phase::draining:
      if (link_ == Link::connected && (over || drained())) return say_farewell(now);
      if (!over) return;
      break;
    case Phase::farewell:
      if (!over) return;
      phase_ = Phase::closing;
      phase_deadline_ = now + kFarewellFor;
      return broker_.disconnect();
    case Phase::closing:
      if (!over) return;
      break;
  }
  if (link_ != Link::connected) broker_.disconnect();
  phase_ = Phase::finished;
  if (store_ != nullptr) {  // what the broker has not acknowledged is for the next boot
    connection_over(now);
    move_memory_to_disk();
    write_spool();
    store_->close();
  }
  const json::Samples left = samples();
  log::info("uplink_stopped",
            {{"samples_left", std::to_string(left.queued + left.in_flight + left.stored)},
             {"results_left", std::to_string(results_.size())}});
}

bool Publisher::drained() const {
  return incoming_.empty() && flights_.empty() && results_.empty() && due_.empty() &&
         live_.empty() && spool_.empty() && backlog_.rows() == 0;
}

void Publisher::say_farewell(SteadyTime now) {
  phase_ = Phase::farewell;
  phase_deadline_ = now + kFarewellFor;
  Publication publication;
  publication.topic = base_ + "/state";
  publication.payload = json::agent_offline(utc_ms_(), "stopped", settings_.boot);
  publication.retain = Retain::yes;
  send(FarewellFlight{}, std::move(publication));
}

// ---- small things -------------------------------------------------------------------------------

/// Whether something waits for room that an acknowledgement makes, or for the acknowledgement
/// itself. Otherwise each would wake this thread for nothing but a number.
bool Publisher::acknowledgements_matter() const {
  return phase_ != Phase::running || link_ != Link::connected || !results_.empty() ||
         history_flights_ != 0 || flights_.size() >= window_ / 2;
}

SteadyTime Publisher::next_wake(SteadyTime now) const {
  if (!incoming_.empty()) return now;
  SteadyTime wake = next_tick_;
  const auto at = [&wake](SteadyTime time) { wake = std::min(wake, time); };
  if (phase_ != Phase::running) at(phase_deadline_);
  if (awaits_decisions_) at(now + kHoldAtMost);
  if (lets_in_) at(std::max(let_in_at_, now + kHoldAtMost));
  if (unasked_dropped_ != 0) at(drop_logged_at_ + kLogDropsEvery);
  if (link_ == Link::waiting || link_ == Link::leaving) at(retry_at_);
  if (link_ == Link::connecting) at(connect_deadline_);
  if (clean_up_until_) at(*clean_up_until_);
  if (!live_.empty()) at(live_.front().since + kLiveFor);
  if (!spool_.empty()) at(commit_at_);
  if (store_ != nullptr && store_->has_pending()) at(now + kCommitWithin);
  if (link_ != Link::connected) return wake;
  // What is due now and found no room goes with the next acknowledgement, which is news.
  const auto later = [&](SteadyTime time) {
    if (time > now) at(time);
  };
  for (const auto& [key, due] : due_) later(due.not_before);
  for (const std::uint64_t key : refused_results_)
    for (const PendingResult::Copy& copy : results_.at(key).copies) later(copy.due.not_before);
  if (history_flights_ == 0) later(history_rests_until_);
  for (const auto& [device, pause] : pauses_)
    if (backlog_.has_waiting(device) ||
        (store_ != nullptr && store_->samples().has_waiting(device)))
      later(pause.until);
  if (!flights_.empty()) at(now + kAcknowledgedWithin);
  if (phase_ == Phase::running) at(watch_wake());
  if (store_ == nullptr || !store_->is_writable()) return wake;
  for (const auto& [id, flight] : flights_)
    if (const auto* live = std::get_if<LiveFlight>(&flight); live != nullptr && !live->live.stored)
      at(live->live.since + kLiveFor);
  return wake;
}

std::string Publisher::device_topic(std::uint32_t device) const {
  return base_ + "/" + config_.devices.at(device).name;
}

std::string Publisher::data_topic(const StreamKey& stream) const {
  return base_ + "/" + stream.first + "/data/" + stream.second;
}

std::string Publisher::health_text(SteadyTime now) const {
  json::Health health;
  health.ts_ms = utc_ms_();
  health.boot = settings_.boot;
  health.version = settings_.version;
  health.uptime = std::chrono::duration_cast<seconds>(now - *started_);
  health.samples = samples();
  health.field = field_;
  for (const DeviceConfig& device : config_.devices) {
    const auto found = dropped_.find(device.name);
    health.dropped.push_back(found == dropped_.end() ? 0 : found->second);
    const auto paused = pauses_.find(device.name);
    health.refused.push_back(paused == pauses_.end() ? std::string()
                                                     : hex_code(paused->second.reason_code));
  }
  health.commands = commands_;
  health.store_state = store_ == nullptr ? "memory" : store_->state();
  if (store_ != nullptr) {
    health.store_set_aside = store_->set_aside();
    health.audit_records = store_->audit().head().records;
    health.audit_head = to_text(store_->audit().head().hash);
  }
  health.store_bytes = backlog_.bytes() + (store_ == nullptr ? 0 : store_->bytes());
  const std::uint64_t room = store_ == nullptr ? backlog_.max_bytes() : store_->max_bytes();
  if (bytes_per_hour_ && *bytes_per_hour_ > 0)
    health.hours_left =
        static_cast<double>(room - std::min(room, health.store_bytes)) / *bytes_per_hour_;
  const ProcessFacts facts = read_process_facts();
  health.clock_synchronised = facts.clock_synchronised;
  health.rss_bytes = facts.rss_bytes;
  return json::health(health, config_);
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
