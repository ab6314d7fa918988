#include "agent/uplink/samples/sample_delivery.h"

#include <algorithm>
#include <utility>

#include "agent/failpoint.h"
#include "agent/log/log.h"
#include "agent/store/samples/sample_record.h"
#include "agent/uplink/payload/json_payload.h"
#include "agent/uplink/puback.h"

namespace fxagent {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr int kGatherShare = 100;  // a sample waits at most 1/100 of its interval
constexpr milliseconds kGatherMost{5};
// Number of history messages in flight, each of a different stream: the broker gets a stream's next
// message when it has acknowledged the one before.
constexpr std::size_t kHistoryFlights = 2;
// After each history message, history pauses for half of the time that the message took, so that
// live samples and commands regularly find the broker free. kLongestRest limits the pause on slow
// networks.
constexpr int kRestShare = 2;
constexpr milliseconds kLongestRest{100};
// A quarter of the allowed size: a message of 64 KiB delays a live sample by milliseconds.
constexpr std::size_t kHistoryBytes = 16384;
constexpr std::size_t kSmallWindow = 4;
// This many samples behind a full window show that the broker accepts fewer than are produced.
constexpr std::size_t kBackedUp = 4;
constexpr auto kLiveFor = SampleSpool::kLiveFor;
constexpr auto kCommitWithin = SampleSpool::kCommitWithin;

}  // namespace

SampleDelivery::SampleDelivery(const Config& config, std::string boot, Payload& payload,
                               Outgoing& outgoing, JitteredBackoff& backoff, SampleSpool& spool,
                               GuardedStore* store)
    : config_(config),
      boot_(std::move(boot)),
      payload_(payload),
      outgoing_(outgoing),
      backoff_(backoff),
      spool_(spool),
      store_(store),
      meta_hashes_(config.devices.size()),
      history_bytes_(kHistoryBytes) {}

void SampleDelivery::change(const ConfigChange& change) {
  for (const std::uint32_t device : change.devices_end) meta_hashes_.at(device).clear();
  meta_hashes_.resize(config_.devices.size());
}

/// Computed with the first sample of each device: computing those of many devices at once would
/// take too long.
const std::string& SampleDelivery::meta_hash(std::uint32_t device) {
  std::string& hash = meta_hashes_.at(device);
  if (hash.empty()) hash = json::device_meta(config_.devices.at(device)).hash;
  return hash;
}

void SampleDelivery::take(const std::vector<Telemetry>& messages, bool can_go, SteadyTime now) {
  if (messages.empty()) return;
  microseconds patience = kGatherMost;  // zero for groups without an interval
  for (const Telemetry& message : messages) {
    const GroupConfig& group = config_.devices.at(message.device).groups.at(message.group);
    patience = std::min(patience, microseconds(group.interval) / kGatherShare);
  }
  gather_until_ = now - samples_at_ < 2 * patience ? now + patience : now;
  samples_at_ = now;
  std::vector<SampleRow> live;
  for (const Telemetry& message : messages) {
    const DeviceConfig& device = config_.devices.at(message.device);
    SampleRow row;
    row.row_id = next_row_id_++;
    row.device = device.name;
    row.group = device.groups.at(message.group).name;
    row.seq = message.seq;
    row.content = encode_sample(message, device, boot_, meta_hash(message.device));
    row_bytes_ += row.cost();
    if (store_ != nullptr) store_->used(row.device, row.seq);
    if (can_go && may_send(row.device, now))
      live.push_back(std::move(row));
    else
      spool_.add(std::move(row));
  }
  const bool always = config_.store.sync_always;
  const bool stored = always && spool_.hold(live);
  for (SampleRow& row : live) live_.push_back({std::move(row), now, stored});
  if (spool_.gathered() != 0 && always) spool_.commit_by(now);
}

void SampleDelivery::settle(SteadyTime now) {
  overflow(now);
  hold_on_disk(now);
}

/// Moves samples that found no room for 1 s to history. Includes those that would follow within
/// kCommitWithin: a commit costs the same for all.
void SampleDelivery::overflow(SteadyTime now) {
  if (live_.empty() || live_.front().since + kLiveFor > now) return;
  while (!live_.empty() && live_.front().since + kLiveFor - kCommitWithin <= now) {
    spool_.add(std::move(live_.front()));
    live_.pop_front();
  }
}

/// Writes samples that have been in flight for 1 s to disk; they stay in flight. Includes those
/// that would follow soon, like overflow().
void SampleDelivery::hold_on_disk(SteadyTime now) {
  if (!spool_.can_hold()) return;
  std::vector<SampleRow> rows;
  std::vector<LiveRow*> held;
  bool is_time = false;
  for (auto& [id, flight] : flights_) {
    if (!flight.live || flight.live->stored) continue;
    LiveRow& live = *flight.live;
    if (live.since + kLiveFor - kCommitWithin > now) continue;
    is_time = is_time || live.since + kLiveFor <= now;
    rows.push_back(live.row);
    held.push_back(&live);
  }
  if (!is_time || !spool_.hold(rows)) return;
  for (std::size_t i = 0; i < held.size(); ++i) {
    held[i]->row.row_id = rows[i].row_id;
    held[i]->stored = true;
    --in_flight_;
  }
}

/// A small window has one place for history; the rest is for live samples and results.
bool SampleDelivery::has_room_for_history() const {
  const std::size_t most = outgoing_.window() > kSmallWindow ? kHistoryFlights : 1;
  return history_flights_ < most && has_room();
}

bool SampleDelivery::has_room() const {
  // In a larger window two places stay free, so that a result or a state never waits behind
  // samples.
  const std::size_t window = outgoing_.window();
  return outgoing_.size() < (window > kSmallWindow ? window - 2 : window);
}

void SampleDelivery::pump_live(SteadyTime now) {
  while (!live_.empty() && has_room()) {
    LiveRow live = std::move(live_.front());
    live_.pop_front();
    if (!may_send(live.row.device, now) || !decode_sample(live.row.content, record_)) {
      spool_.add(std::move(live));
      continue;
    }
    Publication publication = payload_.sample({live.row.device, live.row.group}, record_);
    if (!live.stored) ++in_flight_;
    ++published_;
    const std::uint64_t id = outgoing_.send(*this, std::move(publication));
    flights_.emplace(id, Flight{std::move(live), {}, now});
  }
}

void SampleDelivery::make_history(const std::set<std::string>& devices) {
  if (devices.empty()) return;
  const auto first = std::stable_partition(
      live_.begin(), live_.end(),
      [&devices](const LiveRow& live) { return !devices.contains(live.row.device); });
  for (auto live = first; live != live_.end(); ++live) spool_.add(std::move(*live));
  live_.erase(first, live_.end());
}

void SampleDelivery::pump_history(bool rests, SteadyTime now) {
  if (rests && now < history_rests_until_) return;
  while (live_.empty() && has_room_for_history()) {
    auto history = spool_.next(payload_, history_bytes_,
                               [&](const std::string& device) { return may_send(device, now); });
    if (!history) return;
    Publication publication = payload_.history(history->batch);
    ++history_flights_;
    published_ += history->batch.row_ids.size();
    const std::uint64_t id = outgoing_.send(*this, std::move(publication));
    flights_.emplace(id, Flight{std::nullopt, std::move(*history), now});
  }
}

void SampleDelivery::rest(SteadyTime since, SteadyTime now) {
  --history_flights_;
  const auto rest = std::min<SteadyTime::duration>((now - since) / kRestShare, kLongestRest);
  history_rests_until_ = std::max(history_rests_until_, now + rest);
}

void SampleDelivery::connection_began() {
  history_bytes_ = kHistoryBytes;
  pauses_.clear();
}

void SampleDelivery::connection_ended() {
  for (auto& [id, flight] : std::exchange(flights_, {})) {
    if (flight.live)
      spool_.add(std::move(*flight.live));
    else
      spool_.returned(flight.history);
  }
  history_flights_ = 0;
  in_flight_ = 0;
  spool_live();
}

void SampleDelivery::spool_live() {
  for (LiveRow& live : live_) spool_.add(std::move(live));
  live_.clear();
}

// ---- outcomes -----------------------------------------------------------------------------------

void SampleDelivery::delivered(std::uint64_t id, SteadyTime now) {
  const Flight flight = std::move(flights_.extract(id).mapped());
  if (!flight.live) {
    rest(flight.since, now);
    failpoint("history_acknowledged");
    spool_.remove(flight.history, [this](std::uint64_t count) { acknowledged_ += count; });
    taken(flight.history.batch.device, flight.since);
    return;
  }
  failpoint("sample_acknowledged");
  if (flight.live->stored) {
    spool_.remove(*flight.live, [this](std::uint64_t count) { acknowledged_ += count; });
  } else {
    --in_flight_;
    ++acknowledged_;
  }
  taken(flight.live->row.device, flight.since);
}

void SampleDelivery::failed(const DeliveryFailed& event, SteadyTime now) {
  Flight flight = std::move(flights_.extract(event.id).mapped());
  if (flight.live) return live_failed(std::move(*flight.live), event, now);
  rest(flight.since, now);
  history_failed(flight.history, event, now);
}

void SampleDelivery::live_failed(LiveRow live, const DeliveryFailed& event, SteadyTime now) {
  const SampleRow& row = live.row;
  if (!live.stored) --in_flight_;
  if (is_final(event.reason_code)) {
    log::warn(
        "sample_refused",
        {{"device", row.device}, {"code", hex_code(event.reason_code)}, {"reason", event.text}});
    const auto drop = [this, device = row.device](std::uint64_t count) {
      spool_.drop(device, count);
    };
    return live.stored ? spool_.remove(live, drop) : drop(1);
  }
  pause(row.device, event, now);
  spool_.add(std::move(live));
}

void SampleDelivery::history_failed(const OutgoingHistory& history, const DeliveryFailed& event,
                                    SteadyTime now) {
  const HistoryBatch& batch = history.batch;
  const bool can_be_cut = event.reason_code == kPacketTooLarge && batch.row_ids.size() > 1;
  if (is_final(event.reason_code) && !can_be_cut) {
    log::warn("history_refused", {{"device", batch.device},
                                  {"rows", std::to_string(batch.row_ids.size())},
                                  {"code", hex_code(event.reason_code)},
                                  {"reason", event.text}});
    return spool_.remove(history, [this, device = batch.device](std::uint64_t count) {
      spool_.drop(device, count);
    });
  }
  spool_.returned(history);
  if (can_be_cut)
    history_bytes_ = std::min(history_bytes_, batch.payload.size() / 2);
  else
    pause(batch.device, event, now);
}

/// The broker accepted a message that was sent at `since`. Ends the device's pause, unless the
/// message was sent before the refusal.
void SampleDelivery::taken(const std::string& device, SteadyTime since) {
  const auto found = pauses_.find(device);
  if (found != pauses_.end() && found->second.since < since) pauses_.erase(found);
}

bool SampleDelivery::may_send(const std::string& device, SteadyTime now) const {
  const auto found = pauses_.find(device);
  return found == pauses_.end() || found->second.until <= now;
}

void SampleDelivery::pause(const std::string& device, const DeliveryFailed& event, SteadyTime now) {
  const int reason_code = event.reason_code;
  Pause& pause = pauses_[device];
  pause.reason_code = reason_code;
  if (pause.until > now) return;  // one of several refusals of messages in flight
  pause.since = now;
  pause.until = now + backoff_.after(pause.failures++);
  const std::string again = std::to_string(std::chrono::ceil<seconds>(pause.until - now).count());
  if (reason_code != 0)
    log::warn("samples_refused", {{"device", device},
                                  {"code", hex_code(reason_code)},
                                  {"reason", event.text},
                                  {"again_in_s", again}});
  else
    log::warn("samples_not_sent",
              {{"device", device}, {"reason", event.text}, {"again_in_s", again}});
}

std::optional<int> SampleDelivery::refused(const std::string& device) const {
  const auto found = pauses_.find(device);
  const bool refuses = found != pauses_.end() && found->second.reason_code != 0;
  return refuses ? std::optional(found->second.reason_code) : std::nullopt;
}

bool SampleDelivery::is_backed_up() const { return live_.size() >= kBackedUp; }

SampleDelivery::Counters SampleDelivery::counters() const {
  const auto on_disk = [](const LiveRow& live) { return live.stored; };
  const auto held = static_cast<std::size_t>(std::ranges::count_if(live_, on_disk));
  return {acknowledged_, published_, live_.size() - held, in_flight_};
}

SteadyTime SampleDelivery::next_wake(SteadyTime now) const {
  SteadyTime wake = SteadyTime::max();
  const auto at = [&wake](SteadyTime time) { wake = std::min(wake, time); };
  const auto later = [&](SteadyTime time) {
    if (time > now) at(time);
  };
  if (!live_.empty()) at(live_.front().since + kLiveFor);
  if (has_room_for_history()) later(history_rests_until_);
  for (const auto& [device, pause] : pauses_)
    if (spool_.has_waiting(device)) later(pause.until);
  if (!spool_.can_hold()) return wake;
  for (const auto& [id, flight] : flights_)
    if (flight.live && !flight.live->stored) at(flight.live->since + kLiveFor);
  return wake;
}

}  // namespace fxagent
