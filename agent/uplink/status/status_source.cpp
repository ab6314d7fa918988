#include "agent/uplink/status/status_source.h"

#include <algorithm>
#include <chrono>
#include <map>
#include <ratio>

#include "agent/log/log.h"
#include "agent/process/this_process.h"
#include "agent/store/samples/sample_record.h"
#include "agent/uplink/profile/outlet.h"

namespace fxagent {

using std::chrono::seconds;

namespace {

// Interval of health.
constexpr seconds kTick{60};
// Health goes out with older counters after this.
constexpr seconds kCountersWithin{1};

/// Owned by the values of a group, and by the values that a command's sample made from them.
using Row = std::shared_ptr<const std::string>;

Row row_of(const Telemetry& message, const DeviceConfig& device) {
  std::string row = encode_sample(message, device, {}, {});
  row.shrink_to_fit();
  return std::make_shared<const std::string>(std::move(row));
}

class RecordedValues final : public GroupValues {
 public:
  explicit RecordedValues(Row whole) : whole_(std::move(whole)) {}

  /// Call only before the object is published.
  void put(std::uint32_t tag, Row row) { written_.insert_or_assign(tag, std::move(row)); }

  std::map<std::string, LastValue, std::less<>> by_tag() const override {
    std::map<std::string, LastValue, std::less<>> values;
    SampleRecord record;
    if (whole_) add(*whole_, record, values);
    for (const auto& [tag, row] : written_) add(*row, record, values);
    return values;
  }

 private:
  static void add(const std::string& row, SampleRecord& record,
                  std::map<std::string, LastValue, std::less<>>& values) {
    if (!decode_sample(row, record)) return;  // cannot happen: the row never left memory
    for (RecordedReading& reading : record.readings) {
      LastValue value;
      value.type = reading.type;
      value.scaled = reading.scaled;
      value.value = std::move(reading.value);
      value.bad = reading.bad;
      if (!reading.bad)
        value.ts_ms = record.ts_ms;
      else if (reading.last_ms != 0)
        value.ts_ms = reading.last_ms;
      value.bad_since_ms = reading.bad ? reading.bad_since_ms : 0;
      values.insert_or_assign(std::string(reading.name), std::move(value));
    }
  }

  Row whole_;  ///< null: none yet
  std::map<std::uint32_t, Row> written_;
};

}  // namespace

void LastSamples::change(const ConfigChange& change) {
  if (groups_.empty()) return;
  for (const std::uint32_t device : change.devices_end) groups_.at(device).clear();
  groups_.resize(config_.devices.size());
  for (const std::uint32_t device : change.devices_begin)
    groups_.at(device).resize(config_.devices[device].groups.size());
}

void LastSamples::add(const Telemetry& message) {
  if (groups_.empty())
    for (const DeviceConfig& each : config_.devices) groups_.emplace_back(each.groups.size());
  const DeviceConfig& device = config_.devices.at(message.device);
  auto& group = groups_.at(message.device).at(message.group);
  if (!message.partial) {
    group = std::make_shared<const RecordedValues>(row_of(message, device));
    return;
  }
  // groups_ contains no other type.
  const auto* const before = static_cast<const RecordedValues*>(group.get());
  auto after = before == nullptr ? std::make_shared<RecordedValues>(nullptr)
                                 : std::make_shared<RecordedValues>(*before);
  after->put(message.readings.at(0).tag, row_of(message, device));
  group = std::move(after);
}

StatusSource::StatusSource(Parts parts, std::function<std::int64_t()> utc_ms,
                           std::function<void()> wake, std::function<void()> ask_counters)
    : parts_(std::move(parts)),
      config_(std::make_shared<const Config>(parts_.config)),
      utc_ms_(std::move(utc_ms)),
      board_(std::move(wake)),
      ask_counters_(std::move(ask_counters)),
      last_(parts_.config) {}

void StatusSource::change(const ConfigChange& change) {
  config_ = std::make_shared<const Config>(parts_.config);
  last_.change(change);
  published_.reset();
}

void StatusSource::start(SteadyTime now) {
  started_ = rate_since_ = now;
  next_tick_ = now + kTick;
}

void StatusSource::take(Outbox::Batch& batch, SteadyTime now) {
  pushed_ = batch.pushed;
  if (board_.values_wanted())
    for (const Telemetry& message : batch.telemetry) last_.add(message);
  if (!batch.health) return;
  field_heard_ = now;
  field_ = std::make_shared<const FieldHealth>(std::move(*batch.health));
  std::uint64_t sent = 0;
  for (const DeviceHealth& device : field_->devices) sent += device.collected - device.suppressed;
  sent += field_->ended_collected - field_->ended_suppressed;
  miscounted_ = sent != batch.pushed_at_health;
  if (miscounted_)
    log::error("samples_miscounted", {{"field", std::to_string(sent)},
                                      {"outbox", std::to_string(batch.pushed_at_health)}});
  if (counters_by_) health_is_due();
}

void StatusSource::request_health(SteadyTime now) {
  if (!ask_counters_) return health_is_due();
  if (counters_by_) return;
  counters_by_ = now + kCountersWithin;
  ask_counters_();
}

void StatusSource::health_is_due() {
  counters_by_.reset();
  parts_.retained.health_is_due();
}

void StatusSource::report(SteadyTime now) {
  if (now >= next_tick_) {
    next_tick_ = now + kTick;
    tick(now);
    if (parts_.session.is_connected()) request_health(now);
  }
  if (board_.is_asked()) at(now);
  if (counters_by_ && now >= *counters_by_) health_is_due();
}

SteadyTime StatusSource::next_wake() const {
  return std::min(next_tick_, counters_by_.value_or(next_tick_));
}

void StatusSource::tick(SteadyTime now) {
  if (const std::uint64_t bytes = parts_.samples.take_row_bytes(); bytes > 0) {
    const auto hours = std::chrono::duration<double, std::ratio<3600>>(now - rate_since_).count();
    bytes_per_hour_ = static_cast<double>(bytes) / hours;
    rate_since_ = now;
  }
  log_unbalanced();
  at(now);
}

std::shared_ptr<const AgentStatus> StatusSource::at(SteadyTime now) {
  if (!published_ || published_at_ != now || board_.is_asked()) {
    AgentStatus status = make(now);
    if (status.store_state != store_state_) {
      store_state_ = status.store_state;
      store_since_ms_ = status.ts_ms;
    }
    status.store_since_ms = store_since_ms_;
    published_ = std::make_shared<const AgentStatus>(std::move(status));
    published_at_ = now;
    board_.publish(published_, now);
  }
  return published_;
}

void StatusSource::log_unbalanced() const {
  const SampleCounts now_here = samples();
  if (!now_here.balanced())
    log::error("samples_unbalanced", {{"collected", std::to_string(now_here.collected)},
                                      {"recovered", std::to_string(now_here.recovered)},
                                      {"suppressed", std::to_string(now_here.suppressed)},
                                      {"queued", std::to_string(now_here.queued)},
                                      {"in_flight", std::to_string(now_here.in_flight)},
                                      {"stored", std::to_string(now_here.stored)},
                                      {"acknowledged", std::to_string(now_here.acknowledged)},
                                      {"dropped", std::to_string(now_here.dropped)}});
}

SampleCounts StatusSource::samples() const {
  SampleCounts samples;
  parts_.samples.add_to(samples);
  for (const DeviceHealth& device : field_->devices) samples.suppressed += device.suppressed;
  samples.suppressed += field_->ended_suppressed;
  samples.collected = pushed_ + samples.suppressed;
  samples.miscounted = miscounted_;
  return samples;
}

BrokerStatus StatusSource::broker(SteadyTime now) const {
  const Session& session = parts_.session;
  const SteadyTime since = std::max(session.since(), started_);
  BrokerStatus status;
  status.server = session.server();
  status.connected = session.is_connected();
  const Subscriptions& subscriptions = parts_.subscriptions;
  status.not_heard_why = subscriptions.not_heard_why().value_or("");
  status.subscribed =
      status.connected && !subscriptions.not_heard_why() && !subscriptions.awaits_first_suback();
  status.since_ms =
      utc_ms_() - std::chrono::duration_cast<std::chrono::milliseconds>(now - since).count();
  status.why = session.why_not_connected();
  if (status.connected && parts_.retained.is_refused()) status.refused.emplace_back("states");
  if (status.connected && parts_.results.is_refused()) status.refused.emplace_back("results");
  return status;
}

AgentStatus StatusSource::make(SteadyTime now) const {
  AgentStatus status;
  status.config = config_;
  status.config_status = config_status_;
  status.ts_ms = utc_ms_();
  status.made_at = now;
  status.field_heard = field_heard_;
  status.command_durations = parts_.results.durations();
  status.boot = parts_.boot;
  status.version = parts_.version;
  status.uptime = std::chrono::duration_cast<seconds>(now - started_);
  status.conflict = conflict_;
  status.broker = broker(now);
  for (const Outlet* outlet : parts_.outlets) status.profiles.push_back(outlet->status());
  status.samples = samples();
  status.field = field_;
  status.devices = parts_.states.all();
  if (board_.values_wanted()) status.values = last_.groups();
  const WaitingSamples& waiting = parts_.samples.spool().waiting();
  for (const DeviceConfig& device : parts_.config.devices) {
    status.dropped.push_back(waiting.dropped().of(device.name));
    const auto refused = parts_.samples.refused().reason(device.name);
    status.refused.push_back(refused ? hex_code(*refused) : std::string());
  }
  status.commands = parts_.command_results.counts();
  const auto& last = parts_.command_results.last();
  status.last_commands.assign(last.begin(), last.end());
  status.store_state = parts_.store == nullptr ? "memory" : parts_.store->state();
  status.store_bytes = waiting.backlog().bytes();
  if (parts_.store != nullptr) {
    const GuardedStore::Figures store = parts_.store->figures();
    status.store_bytes += store.bytes;
    status.store_set_aside = store.set_aside;
    status.audit_records = store.audit.records;
    status.audit_head = to_text(store.audit.hash);
  }
  const std::uint64_t room =
      parts_.store == nullptr ? waiting.backlog().max_bytes() : parts_.store->max_bytes();
  if (bytes_per_hour_)
    status.hours_left =
        static_cast<double>(room - std::min(room, status.store_bytes)) / *bytes_per_hour_;
  const ProcessFacts facts = read_process_facts();
  status.clock_synchronised = facts.clock_synchronised;
  status.rss_bytes = facts.rss_bytes;
  return status;
}

}  // namespace fxagent
