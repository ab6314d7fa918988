#include "agent/uplink/samples/sample_delivery.h"

#include <algorithm>

#include "agent/failpoint.h"
#include "agent/log/log.h"
#include "agent/uplink/payload/json_payload.h"

namespace fxagent {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

constexpr int kGatherShare = 100;  // a sample waits at most 1/100 of its interval
constexpr milliseconds kGatherMost{5};
// This many samples behind a full window show that the broker accepts fewer than are produced.
constexpr std::size_t kBackedUp = 4;
constexpr auto kLiveFor = SampleSpool::kLiveFor;
constexpr auto kCommitWithin = SampleSpool::kCommitWithin;

}  // namespace

SampleDelivery::SampleDelivery(const Config& config, std::string boot, SamplePayload& payload,
                               Outgoing& outgoing, JitteredBackoff& backoff, GuardedStore* store,
                               std::size_t backlog_bytes)
    : config_(config),
      boot_(std::move(boot)),
      payload_(payload),
      outgoing_(outgoing),
      refused_(backoff),
      spool_(store, backlog_bytes),
      history_(payload, outgoing, refused_, spool_.waiting()),
      meta_hashes_(config.devices.size()) {}

void SampleDelivery::change(const ConfigChange& change) {
  for (const std::uint32_t device : change.devices_end) meta_hashes_.at(device).clear();
  meta_hashes_.resize(config_.devices.size());
}

void SampleDelivery::take(const Outbox::Batch& batch, bool can_go, SteadyTime now) {
  for (const auto& [device, count] : batch.dropped)
    spool_.waiting().dropped().add(config_.devices.at(device).name, count, DropCause::outbox);
  if (batch.telemetry.empty()) return;
  microseconds patience = kGatherMost;  // zero for groups without an interval
  std::vector<SampleRow> live;
  for (const Telemetry& message : batch.telemetry) {
    const DeviceConfig& device = config_.devices.at(message.device);
    const GroupConfig& group = device.groups.at(message.group);
    patience = std::min(patience, microseconds(group.interval) / kGatherShare);
    SampleRow row;
    row.row_id = next_row_id_++;
    row.stream = {device.name, group.name};
    row.seq = message.seq;
    // Computed with the first sample of each device: for many devices at once it takes too long.
    std::string& hash = meta_hashes_.at(message.device);
    if (hash.empty()) hash = json::device_meta(device).hash;
    row.content = encode_sample(message, device, boot_, hash);
    row_bytes_ += row.cost();
    spool_.used(row.stream.device, row.seq);
    if (can_go && may_send(row.stream.device, now))
      live.push_back(std::move(row));
    else
      spool_.add(std::move(row));
  }
  gather_until_ = now - samples_at_ < 2 * patience ? now + patience : now;
  samples_at_ = now;
  const bool always = config_.store.sync_always;
  const bool stored = always && spool_.hold(live);
  for (SampleRow& row : live) live_.push_back({std::move(row), now, stored});
  if (always) spool_.commit_by(now);
}

bool SampleDelivery::may_send(const std::string& device, SteadyTime now) const {
  return refused_.may_send(device, now) && payload_.may_send(device);
}

/// Samples that found no room for 1 s become history, and with them those that would follow within
/// kCommitWithin: a commit costs the same for all.
void SampleDelivery::settle(SteadyTime now, bool can_wait) {
  if (!live_.empty() && live_.front().since + kLiveFor <= now)
    while (!live_.empty() && live_.front().since + kLiveFor - kCommitWithin <= now) {
      spool_.add(std::move(live_.front()));
      live_.pop_front();
    }
  hold_on_disk(now);
  spool_.commit(now, can_wait);
}

/// Writes samples that have been in flight for 1 s to disk; they stay in flight. Includes those
/// that would follow soon. Also writes those of a stream whose younger samples are written now:
/// after a reconnect, rows on disk leave before those that the disk has refused.
void SampleDelivery::hold_on_disk(SteadyTime now) {
  if (!spool_.waiting().can_write()) return;
  std::vector<SampleRow> rows;
  std::vector<LiveRow*> held;
  bool is_time = false;
  for (auto& [id, flight] : flights_) {
    LiveRow& live = flight.live;
    if (live.stored) continue;
    const bool younger_follow = spool_.is_due(live.row.stream, now);
    if (!younger_follow && live.since + kLiveFor - kCommitWithin > now) continue;
    is_time = is_time || younger_follow || live.since + kLiveFor <= now;
    rows.push_back(live.row);
    held.push_back(&live);
  }
  if (!is_time || !spool_.hold(rows)) return;
  for (std::size_t i = 0; i < held.size(); ++i) {
    held[i]->row.row_id = rows[i].row_id;
    held[i]->stored = true;
  }
}

void SampleDelivery::pump_live(SteadyTime now) {
  while (!live_.empty() && outgoing_.has_room_for_samples()) {
    LiveRow live = std::move(live_.front());
    live_.pop_front();
    if (!may_send(live.row.stream.device, now) || !decode_sample(live.row.content, record_)) {
      spool_.add(std::move(live));
      continue;
    }
    auto publications = payload_.sample(live.row.stream, record_);
    if (publications.empty()) {
      spool_.waiting().remove(live, SampleEnd::acknowledged);
      continue;
    }
    ++published_;
    const std::uint64_t id = outgoing_.send_group(*this, std::move(publications));
    flights_.emplace(id, Flight{std::move(live), now});
  }
}

void SampleDelivery::pump_history(bool rests, SteadyTime now) {
  if (live_.empty()) history_.pump(rests, now);
}

void SampleDelivery::make_history(const std::set<std::string>& devices) {
  if (devices.empty()) return;
  const auto moved = std::ranges::stable_partition(
      live_, [&devices](const LiveRow& live) { return !devices.contains(live.row.stream.device); });
  for (LiveRow& live : moved) spool_.add(std::move(live));
  live_.erase(moved.begin(), moved.end());
}

void SampleDelivery::connection_began() {
  refused_.clear();
  history_.connection_began();
}

void SampleDelivery::connection_ended() {
  for (auto& [id, flight] : std::exchange(flights_, {})) spool_.add(std::move(flight.live));
  spool_live();
  // The next connection may begin at once, and this process may end before it.
  spool_.commit_by(SteadyTime::min());
  history_.connection_ended();
}

void SampleDelivery::spool_live() {
  for (LiveRow& live : live_) spool_.add(std::move(live));
  live_.clear();
}

// ---- outcomes -----------------------------------------------------------------------------------

void SampleDelivery::delivered(std::uint64_t id, SteadyTime) {
  const Flight flight = std::move(flights_.extract(id).mapped());
  failpoint("sample_acknowledged");
  spool_.waiting().remove(flight.live, SampleEnd::acknowledged);
  refused_.accepted(flight.live.row.stream.device, flight.since);
}

void SampleDelivery::failed(const DeliveryFailed& event, SteadyTime now) {
  LiveRow live = std::move(flights_.extract(event.id).mapped().live);
  const SampleRow& row = live.row;
  payload_.undelivered(row.stream.device);
  if (is_final(event.reason_code)) {
    log::warn("sample_refused", {{"device", row.stream.device},
                                 {"code", hex_code(event.reason_code)},
                                 {"reason", event.text}});
    return spool_.waiting().remove(live, SampleEnd::refused);
  }
  refused_.refused(row.stream.device, event, now);
  spool_.add(std::move(live));
}

bool SampleDelivery::is_backed_up() const { return live_.size() >= kBackedUp; }

void SampleDelivery::add_to(SampleCounts& counts) const {
  spool_.add_to(counts);
  counts.queued += static_cast<std::uint64_t>(std::ranges::count(live_, false, &LiveRow::stored));
  counts.in_flight += static_cast<std::uint64_t>(
      std::ranges::count_if(flights_, [](const auto& each) { return !each.second.live.stored; }));
  counts.published += published_ + history_.published();
}

SteadyTime SampleDelivery::next_wake(SteadyTime now) const {
  SteadyTime wake = spool_.next_wake(now);
  const auto at = [&wake](SteadyTime time) { wake = std::min(wake, time); };
  if (!live_.empty()) at(live_.front().since + kLiveFor);
  if (!spool_.waiting().can_write()) return wake;
  for (const auto& [id, flight] : flights_)
    if (!flight.live.stored) at(flight.live.since + kLiveFor);
  return wake;
}

}  // namespace fxagent
