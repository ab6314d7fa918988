#include "agent/store/samples/guarded_samples.h"

#include <algorithm>
#include <utility>

namespace fxagent {
namespace {

/// Rows that the disk's thread writes, and whether it has.
struct AppendCall {
  std::vector<SampleRow> rows;
  bool on_disk = false;
};

}  // namespace

void GuardedSamples::append(std::vector<SampleRow> rows, Stored then) {
  if (guard_.hangs() || rows.empty()) return then(std::move(rows), false);
  const auto call = std::make_shared<AppendCall>(AppendCall{std::move(rows)});
  std::set<StreamKey> streams;
  for (const SampleRow& row : call->rows) streams.insert(row.stream);
  const std::size_t count = call->rows.size();
  const auto end = [this, call, then = std::move(then)] {
    at_disk_ = 0;
    streams_at_disk_.clear();
    then(std::move(call->rows), call->on_disk);
  };
  const bool in_time = guard_.run(
      [this, call] { call->on_disk = samples_.append(call->rows, StoredSamples::Hold::no); }, end);
  if (in_time) return end();
  at_disk_ = count;
  streams_at_disk_ = std::move(streams);
}

bool GuardedSamples::hold(std::vector<SampleRow>& rows) {
  if (guard_.hangs() || rows.empty()) return false;
  const auto call = std::make_shared<AppendCall>(AppendCall{rows});
  const bool in_time = guard_.run(
      [this, call] { call->on_disk = samples_.append(call->rows, StoredSamples::Hold::yes); },
      [this, call] {
        // The caller treats them as not stored.
        if (!call->on_disk) return;
        for (const SampleRow& row : call->rows) samples_.remove(row.row_id);
      });
  if (!in_time || !call->on_disk) return false;
  rows = std::move(call->rows);
  return true;
}

std::optional<HistoryBatch> GuardedSamples::next(std::shared_ptr<HistoryMessage> message,
                                                 const MaySend& may_send) {
  while (!guard_.hangs()) {
    const auto stream = samples_.streams().oldest_waiting(may_send);
    if (!stream) return std::nullopt;
    const auto batch = std::make_shared<std::optional<HistoryBatch>>();
    const bool in_time =
        guard_.run([this, message, stream, batch] { *batch = samples_.next(*stream, *message); },
                   [this, batch] {
                     if (*batch) samples_.returned(**batch);
                   });
    if (!in_time) return std::nullopt;
    if (*batch) return std::move(*batch);
    // If all rows of the stream were damaged, they are gone now: try the next stream.
    if (samples_.streams().oldest_waiting(may_send) == stream) return std::nullopt;
  }
  return std::nullopt;
}

/// Makes the change now, or in take_up() if the store hangs.
void GuardedSamples::change(std::function<void()> rows) {
  guard_.hangs() ? waiting_.rows.push_back(std::move(rows)) : rows();
}

void GuardedSamples::returned(const HistoryBatch& batch) {
  change([this, batch] { samples_.returned(batch); });
}

void GuardedSamples::release(std::uint64_t row_id) {
  change([this, row_id] { samples_.release(row_id); });
}

void GuardedSamples::remove(const HistoryBatch& batch, Removed then) {
  change([this, batch, then = std::move(then)] { then(samples_.remove(batch)); });
}

void GuardedSamples::remove(std::uint64_t row_id, Removed then) {
  change([this, row_id, then = std::move(then)] { then(samples_.remove(row_id)); });
}

bool GuardedSamples::has_waiting(const std::string& device) const {
  return !guard_.hangs() && samples_.streams().has_waiting(device);
}

bool GuardedSamples::is_ahead_of_memory(const StreamKey& stream) const {
  if (guard_.hangs()) return had_rows_ || streams_at_disk_.contains(stream);
  return samples_.streams().has_waiting(stream) || samples_.streams().is_on_the_way(stream);
}

std::map<std::string, std::uint64_t> GuardedSamples::take_dropped() {
  if (!guard_.hangs()) remember();
  return std::exchange(dropped_, {});
}

void GuardedSamples::remember() {
  had_rows_ = samples_.rows() > 0;
  for (const auto& [device, count] : samples_.take_dropped()) dropped_[device] += count;
}

void GuardedSamples::used(const std::string& device, std::uint64_t seq) {
  if (guard_.hangs()) {
    std::uint64_t& last = waiting_.used[device];
    last = std::max(last, seq);
  } else if (numbers_.asks_disk(device, seq)) {
    guard_.run([this, device, seq] { numbers_.used(device, seq); });
  } else {
    numbers_.used(device, seq);
  }
}

std::vector<std::uint64_t> GuardedSamples::join(const std::vector<std::string>& devices,
                                                std::int64_t utc_ms) {
  if (guard_.hangs()) waiting_.joined.insert(waiting_.joined.end(), devices.begin(), devices.end());
  auto last = guard_.ask<std::vector<std::uint64_t>>(
      [this, devices, utc_ms] { return numbers_.join(devices, utc_ms); });
  // If the store hangs, start at the clock: it is above every number of an earlier boot.
  last.resize(devices.size(), static_cast<std::uint64_t>(utc_ms));
  return last;
}

DiskGuard::Work GuardedSamples::take_up(std::int64_t utc_ms) {
  Waiting waiting = std::exchange(waiting_, {});
  for (const auto& change : waiting.rows) change();
  return [this, utc_ms, joined = std::move(waiting.joined), last = std::move(waiting.used)] {
    numbers_.join(joined, utc_ms);
    for (const auto& [device, seq] : last) numbers_.used(device, seq);
    if (!last.empty()) numbers_.write_all();
  };
}

}  // namespace fxagent
