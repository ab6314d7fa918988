#include "agent/uplink/samples/sample_spool.h"

#include "agent/handover/status.h"
#include "agent/log/log.h"

namespace fxagent {

void RefusedDevices::refused(const std::string& device, const DeliveryFailed& event,
                             SteadyTime now) {
  const int reason_code = event.reason_code;
  Pause& pause = pauses_[device];
  pause.reason_code = reason_code;
  if (pause.until > now) return;  // one of several refusals of messages in flight
  pause.since = now;
  pause.until = now + backoff_.after(pause.failures++);
  const std::string again =
      std::to_string(std::chrono::ceil<std::chrono::seconds>(pause.until - now).count());
  if (reason_code != 0)
    log::warn("samples_refused", {{"device", device},
                                  {"code", hex_code(reason_code)},
                                  {"reason", event.text},
                                  {"again_in_s", again}});
  else
    log::warn("samples_not_sent",
              {{"device", device}, {"reason", event.text}, {"again_in_s", again}});
}

void RefusedDevices::accepted(const std::string& device, SteadyTime since) {
  const auto found = pauses_.find(device);
  if (found != pauses_.end() && found->second.since < since) pauses_.erase(found);
}

bool RefusedDevices::may_send(const std::string& device, SteadyTime now) const {
  const auto found = pauses_.find(device);
  return found == pauses_.end() || found->second.until <= now;
}

std::optional<int> RefusedDevices::reason(const std::string& device) const {
  const auto found = pauses_.find(device);
  const bool refuses = found != pauses_.end() && found->second.reason_code != 0;
  return refuses ? std::optional(found->second.reason_code) : std::nullopt;
}

SteadyTime RefusedDevices::next_end(SteadyTime now,
                                    const std::function<bool(const std::string&)>& matters) const {
  SteadyTime next = SteadyTime::max();
  for (const auto& [device, pause] : pauses_)
    if (pause.until > now && matters(device)) next = std::min(next, pause.until);
  return next;
}

void WaitingSamples::upkeep(SteadyTime now, std::int64_t utc_ms) {
  if (store_ == nullptr) return;
  store_->upkeep(now, utc_ms);
  count_dropped();
}

void WaitingSamples::append(std::vector<SampleRow> rows) {
  // While older rows are in memory, these queue behind them.
  if (store_ != nullptr && backlog_.rows() == 0) return store(std::move(rows));
  for (SampleRow& row : rows) backlog_.append(std::move(row));
  count_dropped();
}

void WaitingSamples::move_memory_to_disk() {
  if (can_write() && backlog_.rows() != 0) store(backlog_.take_waiting());
}

void WaitingSamples::store(std::vector<SampleRow> rows) {
  if (rows.empty()) return;
  store_->samples().append(std::move(rows), [this](std::vector<SampleRow> given, bool on_disk) {
    if (!on_disk)
      for (SampleRow& row : given) backlog_.append(std::move(row));
    count_dropped();
  });
}

std::optional<OutgoingHistory> WaitingSamples::next(
    SamplePayload& payload, std::size_t max_bytes,
    const std::function<bool(const std::string&)>& may_send) {
  const auto from_disk = [&](const StreamKey& stream) {
    return may_send(stream.device) && !backlog_.is_on_the_way(stream);
  };
  const auto from_memory = [&](const StreamKey& stream) {
    return may_send(stream.device) &&
           (store_ == nullptr || !store_->samples().is_ahead_of_memory(stream));
  };
  if (store_ != nullptr) {
    const auto message = payload.begin_history(max_bytes);
    auto batch = store_->samples().next(message, from_disk);
    count_dropped();
    if (batch) return OutgoingHistory{message->take(batch->stream), std::move(*batch), true};
  }
  if (backlog_.rows() == 0) return std::nullopt;
  const auto message = payload.begin_history(max_bytes);
  auto batch = backlog_.next(*message, from_memory);
  count_dropped();
  if (batch) return OutgoingHistory{message->take(batch->stream), std::move(*batch), false};
  return std::nullopt;
}

void WaitingSamples::returned(const OutgoingHistory& message) {
  message.on_disk ? store_->samples().returned(message.batch) : backlog_.returned(message.batch);
}

void WaitingSamples::remove(const OutgoingHistory& message, SampleEnd end) {
  const auto count = counted_as(end, message.batch.stream.device);
  message.on_disk ? store_->samples().remove(message.batch, count)
                  : count(backlog_.remove(message.batch));
}

void WaitingSamples::remove(const LiveRow& live, SampleEnd end) {
  const auto count = counted_as(end, live.row.stream.device);
  live.stored ? store_->samples().remove(live.row.row_id, count) : count(1);
}

GuardedSamples::Removed WaitingSamples::counted_as(SampleEnd end, const std::string& device) {
  if (end == SampleEnd::acknowledged) return [this](auto count) { acknowledged_ += count; };
  return [this, device](auto count) { dropped_.add(device, count, DropCause::refused); };
}

bool WaitingSamples::has_waiting(const std::string& device) const {
  return backlog_.has_waiting(device) ||
         (store_ != nullptr && store_->samples().has_waiting(device));
}

void WaitingSamples::count_dropped() {
  for (const auto& [device, count] : backlog_.take_dropped())
    dropped_.add(device, count, DropCause::memory);
  if (store_ == nullptr) return;
  for (const auto& [device, count] : store_->samples().take_dropped())
    dropped_.add(device, count, DropCause::store);
}

void WaitingSamples::add_to(SampleCounts& counts) const {
  counts.stored += backlog_.rows();
  counts.dropped += dropped_.total();
  counts.acknowledged += acknowledged_;
  if (store_ == nullptr) return;
  const GuardedStore::Figures figures = store_->figures();
  counts.queued += store_->samples().at_disk();
  counts.stored += figures.rows;
  counts.recovered += figures.recovered;
}

void SampleSpool::add(LiveRow live) {
  if (live.stored)
    store_->samples().release(live.row.row_id);
  else
    add(std::move(live.row));
  commit_by(live.since + kLiveFor);
}

void SampleSpool::commit(SteadyTime now, bool can_wait) {
  if (!spool_.empty()) {
    if (can_wait && waiting_.can_write() && now < commit_at_) return;
    waiting_.append(std::exchange(spool_, {}));
  }
  commit_at_ = now + kCommitWithin;
}

bool SampleSpool::is_due(const StreamKey& stream, SteadyTime now) const {
  const auto is_of_stream = [&](const SampleRow& row) { return row.stream == stream; };
  return now >= commit_at_ && std::ranges::any_of(spool_, is_of_stream);
}

bool SampleSpool::hold(std::vector<SampleRow>& rows) {
  if (store_ == nullptr || !store_->samples().hold(rows)) return false;
  waiting_.count_dropped();
  return true;
}

void SampleSpool::close() {
  if (store_ == nullptr) return;
  waiting_.move_memory_to_disk();
  waiting_.append(std::exchange(spool_, {}));
  store_->close();
}

SteadyTime SampleSpool::next_wake(SteadyTime now) const {
  const SteadyTime wake = spool_.empty() ? SteadyTime::max() : commit_at_;
  const bool at_disk = store_ != nullptr && store_->has_pending();
  return at_disk ? std::min(wake, now + kCommitWithin) : wake;
}

void SampleSpool::add_to(SampleCounts& counts) const {
  counts.queued += spool_.size();
  waiting_.add_to(counts);
}

}  // namespace fxagent
