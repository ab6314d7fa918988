#include "agent/store/samples/stored_samples.h"

#include <algorithm>
#include <chrono>
#include <string_view>
#include <utility>

#include "agent/failpoint.h"
#include "agent/log/log.h"

namespace fxagent {
namespace {

void log_damaged(const StreamKey& stream, std::size_t rows) {
  log::error("store", {{"state", "damaged"},
                       {"device", stream.first},
                       {"group", stream.second},
                       {"rows_dropped", std::to_string(rows)}});
}

}  // namespace

void StoredSamples::load(SQLite::Database& database) {
  removed_.clear();
  streams_.clear();
  table_.emplace(database);
  table_->each_stream([this](const SampleTable::Sum& sum) {
    streams_.found(sum.stream, sum.rows, sum.cost, sum.oldest);
    next_row_id_ = std::max(next_row_id_, sum.newest + 1);
  });
}

void StoredSamples::unload(Rows rows) {
  table_.reset();
  if (rows == Rows::kept) return;
  removed_.clear();
  for (const auto& [device, count] : streams_.clear())
    if (rows == Rows::lost) dropped_[device] += count;
}

bool StoredSamples::write_pending(std::size_t /*at_most*/) {
  for (const std::uint64_t row_id : removed_) table_->remove(row_id);
  is_removal_written_ = true;
  return false;
}

void StoredSamples::committed() {
  if (is_removal_written_) removed_.clear();
}

bool StoredSamples::append(std::vector<SampleRow>& rows, Hold hold) {
  if (!disk_.is_writable() || rows.empty()) return disk_.is_writable();
  failpoint("sample_unstored");
  std::vector<SampleStreams::Row> gone;
  const bool written = disk_.commit("append", StoreDisk::Sync::full, [&] {
    disk_.parts().write_pending();
    std::uint64_t added = 0;
    std::uint64_t row_id = next_row_id_;
    std::map<std::string, std::uint64_t> highest;
    for (const SampleRow& row : rows) {
      added += row.cost();
      highest[row.device] = std::max(highest[row.device], row.seq);
      table_->insert(row_id++, row, disk_.utc_ms());
    }
    numbers_.write_with_samples(highest);
    const std::uint64_t full = streams_.bytes() + added + journal_.bytes_in_commit();
    if (full > config_.max_bytes) gone = table_->delete_oldest(full - config_.max_bytes, 0);
  });
  if (!written) {
    numbers_.refused();
    return false;
  }
  for (SampleRow& row : rows) {
    row.row_id = next_row_id_++;
    const SampleStreams::Row stored{row.row_id, {row.device, row.group}, row.cost()};
    streams_.added(stored);
    if (hold == Hold::yes) streams_.take(stored);
  }
  forget(gone);
  failpoint("sample_stored");
  return true;
}

void StoredSamples::forget(const std::vector<SampleStreams::Row>& gone) {
  for (const SampleStreams::Row& row : gone) {
    streams_.remove_oldest(row);
    ++dropped_[row.stream.first];
  }
}

std::optional<HistoryBatch> StoredSamples::next(HistoryMessage& message, const MaySend& may_send) {
  bool is_flushed = false;
  for (;;) {
    const auto key = streams_.oldest_waiting(may_send);
    if (!key) return std::nullopt;
    if (!std::exchange(is_flushed, true) && disk_.is_writable()) disk_.flush();
    if (!table_) return std::nullopt;
    std::size_t dropped = 0;
    auto batch = next_of(*key, message, dropped);
    // If all its rows were damaged and dropped, try the next stream.
    if (batch || dropped == 0) return batch;
  }
}

std::optional<HistoryBatch> StoredSamples::next_of(const StreamKey& key, HistoryMessage& message,
                                                   std::size_t& dropped) {
  BatchBuilder builder(message);
  std::vector<SampleStreams::Row> taken;
  std::vector<SampleStreams::Row> damaged;
  const auto skip = [this](std::uint64_t row_id) {
    return streams_.is_out(row_id) || removed_.contains(row_id);
  };
  const auto take = [&](std::uint64_t row_id, std::optional<RowFormat> format,
                        std::string_view content) {
    const auto added = builder.add(row_id, format, content);
    if (added == BatchBuilder::Added::no_room) return false;
    (added == BatchBuilder::Added::yes ? taken : damaged)
        .push_back({row_id, key, content.size() + SampleRow::kOverhead});
    return true;
  };
  if (!disk_.attempt("read", [&] { table_->each_of(key, skip, take); })) return std::nullopt;
  for (const SampleStreams::Row& row : damaged) {
    streams_.take(row);
    dropped_[key.first] += remove(std::span(&row.row_id, 1));
  }
  dropped = damaged.size();
  if (dropped > 0) log_damaged(key, dropped);
  if (builder.empty()) return std::nullopt;
  for (const SampleStreams::Row& row : taken) streams_.take(row);
  streams_.set_on_the_way(key, true);
  return builder.take(key);
}

std::uint64_t StoredSamples::remove(std::span<const std::uint64_t> row_ids) {
  std::uint64_t count = 0;
  for (const std::uint64_t row_id : row_ids) {
    if (!streams_.remove(row_id)) continue;
    removed_.insert(row_id);
    ++count;
  }
  return count;
}

std::uint64_t StoredSamples::remove(const HistoryBatch& batch) {
  streams_.set_on_the_way({batch.device, batch.group}, false);
  return remove(batch.row_ids);
}

void StoredSamples::returned(const HistoryBatch& batch) {
  streams_.set_on_the_way({batch.device, batch.group}, false);
  for (const std::uint64_t row_id : batch.row_ids) release(row_id);
}

void StoredSamples::drop_old() {
  drop(0, disk_.utc_ms() - std::chrono::milliseconds(config_.max_age).count());
}

void StoredSamples::drop_excess() {
  const std::uint64_t all = streams_.bytes() + journal_.bytes();
  if (all > config_.max_bytes) drop(all - config_.max_bytes, 0);
}

void StoredSamples::drop(std::uint64_t excess, std::int64_t older_than_ms) {
  if (!disk_.is_writable() || rows() == 0) return;
  std::vector<SampleStreams::Row> gone;
  const bool done = disk_.commit("delete", StoreDisk::Sync::as_configured, [&] {
    disk_.parts().write_pending();
    gone = table_->delete_oldest(excess, older_than_ms);
  });
  if (done) forget(gone);
}

void StoredSamples::move_times(std::int64_t by_ms) { table_->move_times(by_ms, first_of_run_); }

}  // namespace fxagent
