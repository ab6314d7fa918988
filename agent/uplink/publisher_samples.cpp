// Samples: live ones, those that go to the disk or wait in memory, and how these go out as history.
#include <algorithm>
#include <utility>

#include "agent/failpoint.h"
#include "agent/log/log.h"
#include "agent/uplink/puback.h"
#include "agent/uplink/publisher.h"

namespace fxagent {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr int kGatherShare = 100;  // of its interval, that a sample may wait for others
constexpr milliseconds kGatherMost{5};
// After each message history rests for as long as that took, so that half of the time nothing
// stands in a live sample's way; no longer than this, for the sake of lines that are slow by
// themselves.
constexpr milliseconds kLongestRest{100};

}  // namespace

json::Samples Publisher::samples() const {
  json::Samples samples;
  for (const DeviceHealth& device : field_.devices) samples.suppressed += device.suppressed;
  samples.collected = pushed_ + samples.suppressed;
  const auto on_disk = [](const LiveRow& live) { return live.stored; };
  const auto held = std::count_if(live_.begin(), live_.end(), on_disk);
  samples.queued = live_.size() - static_cast<std::size_t>(held) + spool_.size();
  samples.in_flight = in_flight_samples_;
  samples.stored = backlog_.rows();
  if (store_ != nullptr) {
    samples.stored += store_->samples().rows();
    samples.recovered = store_->samples().recovered();
  }
  samples.acknowledged = acknowledged_;
  samples.dropped = dropped_total_;
  samples.published = published_;
  samples.miscounted = miscounted_;
  return samples;
}

void Publisher::delivered(const LiveFlight& flight, SteadyTime) {
  const SampleRow& row = flight.live.row;
  failpoint("sample_acknowledged");
  if (flight.live.stored) {
    acknowledged_ += store_->samples().remove(std::span(&row.row_id, 1));
  } else {
    --in_flight_samples_;
    ++acknowledged_;
  }
  pauses_.erase(row.device);
}

void Publisher::delivered(const HistoryFlight& flight, SteadyTime now) {
  rest_history(flight, now);
  failpoint("history_acknowledged");
  acknowledged_ +=
      flight.on_disk ? store_->samples().remove(flight.batch) : backlog_.acknowledged(flight.batch);
  pauses_.erase(flight.batch.device);
}

void Publisher::failed(LiveFlight& flight, const DeliveryFailed& event, SteadyTime now) {
  const SampleRow& row = flight.live.row;
  if (!flight.live.stored) --in_flight_samples_;
  if (is_final(event.reason_code)) {
    log::warn(
        "sample_refused",
        {{"device", row.device}, {"code", hex_code(event.reason_code)}, {"reason", event.text}});
    const std::string device = row.device;
    return drop(device,
                flight.live.stored ? store_->samples().remove(std::span(&row.row_id, 1)) : 1);
  }
  pause(row.device, event.reason_code, now);
  spool(std::move(flight.live));
}

void Publisher::failed(const HistoryFlight& flight, const DeliveryFailed& event, SteadyTime now) {
  rest_history(flight, now);
  const HistoryBatch& batch = flight.batch;
  const bool can_be_cut = event.reason_code == kPacketTooLarge && batch.row_ids.size() > 1;
  if (is_final(event.reason_code) && !can_be_cut) {
    log::warn("history_refused", {{"device", batch.device},
                                  {"rows", std::to_string(batch.row_ids.size())},
                                  {"code", hex_code(event.reason_code)},
                                  {"reason", event.text}});
    return drop(batch.device,
                flight.on_disk ? store_->samples().remove(batch) : backlog_.discard(batch));
  }
  flight.on_disk ? store_->samples().returned(batch) : backlog_.returned(batch);
  if (can_be_cut)
    history_bytes_ = std::min(history_bytes_, batch.payload.size()) / 2;
  else
    pause(batch.device, event.reason_code, now);
}

void Publisher::take_samples(const std::vector<Telemetry>& messages, SteadyTime now) {
  if (messages.empty()) return;
  microseconds patience = kGatherMost;  // none at all for groups without an interval
  for (const Telemetry& message : messages) {
    const GroupConfig& group = config_.devices.at(message.device).groups.at(message.group);
    patience = std::min(patience, microseconds(group.interval) / kGatherShare);
  }
  gather_until_ = now - samples_at_ < 2 * patience ? now + patience : now;
  samples_at_ = now;
  // What is read while the first connection is being made is as live as what comes right after it.
  const bool can_go = (link_ == Link::connected || starting_) && phase_ <= Phase::draining;
  std::vector<SampleRow> live;
  for (const Telemetry& message : messages) {
    const DeviceConfig& device = config_.devices.at(message.device);
    SampleRow row;
    row.row_id = next_row_id_++;
    row.device = device.name;
    row.group = device.groups.at(message.group).name;
    row.seq = message.seq;
    row.json = json::telemetry(message, device, settings_.boot, meta_hashes_.at(message.device));
    row_bytes_ += row.cost();
    if (store_ != nullptr) store_->numbers().used(row.device, row.seq);
    if (can_go && may_send(row.device, now))
      live.push_back(std::move(row));
    else
      spool(std::move(row));
  }
  const bool stored = config_.store.sync_always && store_ != nullptr && !live.empty() &&
                      store_->samples().append(live, Store::Hold::yes);
  for (SampleRow& row : live) live_.push_back({std::move(row), now, stored});
  if (stored) count_dropped();
  if (!spool_.empty() && config_.store.sync_always) commit_at_ = now;
}

/// Samples that found no room for a second wait as history. Those that would follow within
/// kCommitWithin go with them: a commit costs the same for all.
void Publisher::overflow(SteadyTime now) {
  if (live_.empty() || live_.front().since + kLiveFor > now) return;
  while (!live_.empty() && live_.front().since + kLiveFor - kCommitWithin <= now) {
    spool(std::move(live_.front()));
    live_.pop_front();
  }
}

/// Samples that have been in flight for a second are on disk from then on, and stay in flight;
/// together, as in overflow().
void Publisher::hold_on_disk(SteadyTime now) {
  if (store_ == nullptr || !store_->is_writable()) return;
  std::vector<SampleRow> rows;
  std::vector<LiveRow*> held;
  bool is_time = false;
  for (auto& [id, flight] : flights_) {
    auto* live = std::get_if<LiveFlight>(&flight);
    if (live == nullptr || live->live.stored) continue;
    if (live->live.since + kLiveFor - kCommitWithin > now) continue;
    is_time = is_time || live->live.since + kLiveFor <= now;
    rows.push_back(live->live.row);
    held.push_back(&live->live);
  }
  if (!is_time || !store_->samples().append(rows, Store::Hold::yes)) return;
  for (std::size_t i = 0; i < held.size(); ++i) {
    held[i]->row.row_id = rows[i].row_id;
    held[i]->stored = true;
    --in_flight_samples_;
  }
  count_dropped();
}

void Publisher::pump_live(SteadyTime now) {
  while (!live_.empty() && flights_.size() < sample_window()) {
    LiveRow live = std::move(live_.front());
    live_.pop_front();
    if (!may_send(live.row.device, now)) {
      spool(std::move(live));
      continue;
    }
    Publication publication;
    publication.topic = data_topic({live.row.device, live.row.group});
    publication.payload = live.row.json;
    publication.qos = config_.mqtt.qos;
    if (!live.stored) ++in_flight_samples_;
    ++published_;
    send(LiveFlight{std::move(live)}, std::move(publication));
  }
}

void Publisher::rest_history(const HistoryFlight& flight, SteadyTime now) {
  --history_flights_;
  history_rests_until_ = now + std::min<SteadyTime::duration>(now - flight.since, kLongestRest);
}

void Publisher::pump_history(SteadyTime now) {
  // One at a time: a broker that works on several of 64 KiB lets live samples wait for
  // milliseconds.
  if (phase_ == Phase::running && now < history_rests_until_) return;
  while (live_.empty() && history_flights_ == 0 && flights_.size() < sample_window()) {
    auto history = next_history(now);
    if (!history) return;
    Publication publication;
    publication.topic = data_topic({history->batch.device, history->batch.group}) + "/history";
    publication.payload = history->batch.payload;
    publication.qos = config_.mqtt.qos;
    ++history_flights_;
    published_ += history->batch.row_ids.size();
    send(std::move(*history), std::move(publication));
  }
}

/// Rows in memory are younger than those of the same stream on disk, and wait for them.
std::optional<Publisher::HistoryFlight> Publisher::next_history(SteadyTime now) {
  const auto from_disk = [&](const StreamKey& stream) {
    return may_send(stream.first, now) && !backlog_.is_on_the_way(stream);
  };
  const auto from_memory = [&](const StreamKey& stream) {
    return may_send(stream.first, now) &&
           (store_ == nullptr ||
            !(store_->samples().has_waiting(stream) || store_->samples().is_on_the_way(stream)));
  };
  if (store_ != nullptr) {
    auto batch = store_->samples().next(history_bytes_, from_disk);
    count_dropped();
    if (batch) return HistoryFlight{std::move(*batch), true, now};
  }
  auto batch = backlog_.next(history_bytes_, from_memory);
  if (batch) return HistoryFlight{std::move(*batch), false, now};
  return std::nullopt;
}

std::size_t Publisher::sample_window() const {
  // Two places stay free, so that a result or a state never waits behind samples.
  return window_ > 4 ? window_ - 2 : window_;
}

bool Publisher::may_send(const std::string& device, SteadyTime now) const {
  const auto found = pauses_.find(device);
  return found == pauses_.end() || found->second.until <= now;
}

void Publisher::pause(const std::string& device, int reason_code, SteadyTime now) {
  DevicePause& pause = pauses_[device];
  pause.reason_code = reason_code;
  if (pause.until > now) return;  // one refusal among several that were on their way
  pause.until = now + back_off(pause.failures++);
  log::warn(
      "samples_refused",
      {{"device", device},
       {"code", hex_code(reason_code)},
       {"again_in_s", std::to_string(std::chrono::ceil<seconds>(pause.until - now).count())}});
}

void Publisher::spool_live() {
  for (LiveRow& live : live_) spool(std::move(live));
  live_.clear();
}

void Publisher::spool(LiveRow live) {
  if (live.stored)
    store_->samples().release(live.row.row_id);
  else
    spool(std::move(live.row));
  commit_at_ = std::min(commit_at_, live.since + kLiveFor);
}

void Publisher::spool(SampleRow row) { spool_.push_back(std::move(row)); }

void Publisher::commit_spool(SteadyTime now) {
  if (spool_.empty()) {
    commit_at_ = now + kCommitWithin;
    return;
  }
  const bool can_wait = store_ != nullptr && store_->is_writable() && phase_ == Phase::running;
  if (!can_wait || now >= commit_at_) write_spool();
}

void Publisher::write_spool() {
  auto rows = std::exchange(spool_, {});
  // While older rows are in memory, these wait behind them.
  const bool on_disk =
      store_ != nullptr && backlog_.rows() == 0 && store_->samples().append(rows, Store::Hold::no);
  if (!on_disk)
    for (SampleRow& row : rows) backlog_.append(std::move(row));
  count_dropped();
}

void Publisher::move_memory_to_disk() {
  if (store_ == nullptr || !store_->is_writable() || backlog_.rows() == 0) return;
  auto rows = backlog_.take_waiting();
  if (rows.empty()) return;
  if (!store_->samples().append(rows, Store::Hold::no))
    for (SampleRow& row : rows) backlog_.append(std::move(row));
  count_dropped();
}

void Publisher::count_dropped() {
  for (const auto& [device, count] : backlog_.take_dropped()) drop(device, count);
  if (store_ == nullptr) return;
  for (const auto& [device, count] : store_->samples().take_dropped()) drop(device, count);
}

void Publisher::drop(const std::string& device, std::uint64_t count) {
  dropped_[device] += count;
  dropped_total_ += count;
}

}  // namespace fxagent
