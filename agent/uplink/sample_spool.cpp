#include "agent/uplink/sample_spool.h"

#include <span>

namespace fxagent {

void SampleSpool::add(LiveRow live) {
  if (live.stored)
    store_->samples().release(live.row.row_id);
  else
    add(std::move(live.row));
  commit_by(live.since + kLiveFor);
}

void SampleSpool::commit(SteadyTime now, bool can_wait) {
  if (spool_.empty()) {
    commit_at_ = now + kCommitWithin;
    return;
  }
  if (!can_wait || !can_hold() || now >= commit_at_) write();
}

void SampleSpool::write() {
  auto rows = std::exchange(spool_, {});
  // While older rows are in memory, these wait behind them.
  const bool on_disk =
      store_ != nullptr && backlog_.rows() == 0 && store_->samples().append(rows, Store::Hold::no);
  if (!on_disk)
    for (SampleRow& row : rows) backlog_.append(std::move(row));
  count_dropped();
}

void SampleSpool::move_memory_to_disk() {
  if (!can_hold() || backlog_.rows() == 0) return;
  auto rows = backlog_.take_waiting();
  if (rows.empty()) return;
  if (!store_->samples().append(rows, Store::Hold::no))
    for (SampleRow& row : rows) backlog_.append(std::move(row));
  count_dropped();
}

bool SampleSpool::hold(std::vector<SampleRow>& rows) {
  if (store_ == nullptr || rows.empty() || !store_->samples().append(rows, Store::Hold::yes))
    return false;
  count_dropped();
  return true;
}

std::optional<OutgoingHistory> SampleSpool::next(
    Payload& payload, std::size_t max_bytes,
    const std::function<bool(const std::string&)>& may_send) {
  const auto from_disk = [&](const StreamKey& stream) {
    return may_send(stream.first) && !backlog_.is_on_the_way(stream);
  };
  const auto from_memory = [&](const StreamKey& stream) {
    return may_send(stream.first) &&
           (store_ == nullptr ||
            !(store_->samples().has_waiting(stream) || store_->samples().is_on_the_way(stream)));
  };
  if (store_ != nullptr) {
    auto batch = store_->samples().next(*payload.begin_history(max_bytes), from_disk);
    count_dropped();
    if (batch) return OutgoingHistory{std::move(*batch), true};
  }
  auto batch = backlog_.next(*payload.begin_history(max_bytes), from_memory);
  count_dropped();
  if (batch) return OutgoingHistory{std::move(*batch), false};
  return std::nullopt;
}

void SampleSpool::returned(const OutgoingHistory& message) {
  message.on_disk ? store_->samples().returned(message.batch) : backlog_.returned(message.batch);
}

std::uint64_t SampleSpool::remove(const OutgoingHistory& message) {
  return message.on_disk ? store_->samples().remove(message.batch) : backlog_.remove(message.batch);
}

std::uint64_t SampleSpool::remove(const LiveRow& live) {
  return store_->samples().remove(std::span(&live.row.row_id, 1));
}

void SampleSpool::drop(const std::string& device, std::uint64_t count) {
  dropped_[device] += count;
  dropped_total_ += count;
}

void SampleSpool::count_dropped() {
  for (const auto& [device, count] : backlog_.take_dropped()) drop(device, count);
  if (store_ == nullptr) return;
  for (const auto& [device, count] : store_->samples().take_dropped()) drop(device, count);
}

std::uint64_t SampleSpool::dropped(const std::string& device) const {
  const auto found = dropped_.find(device);
  return found == dropped_.end() ? 0 : found->second;
}

bool SampleSpool::has_waiting(const std::string& device) const {
  return backlog_.has_waiting(device) ||
         (store_ != nullptr && store_->samples().has_waiting(device));
}

}  // namespace fxagent
