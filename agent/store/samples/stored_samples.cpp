#include "agent/store/samples/stored_samples.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "agent/failpoint.h"
#include "agent/log/log.h"

namespace fxagent {
namespace {

using sqlite::from_sql;
using sqlite::number;
using sqlite::text;

void log_damaged(const StreamKey& stream, std::size_t rows) {
  log::error("store", {{"state", "damaged"},
                       {"device", stream.first},
                       {"group", stream.second},
                       {"rows_dropped", std::to_string(rows)}});
}

}  // namespace

SampleTable::SampleTable(SQLite::Database& database)
    : database_(database),
      insert_(database, "INSERT INTO samples VALUES(?, ?, ?, ?, ?, ?, ?)"),
      remove_(database, "DELETE FROM samples WHERE id = ?"),
      stream_(database,
              "SELECT id, row, format FROM samples WHERE device = ? AND grp = ? ORDER BY seq, id"),
      oldest_(database,
              "SELECT id, device, grp, created_ms, length(CAST(row AS BLOB)) FROM samples"
              " ORDER BY id") {}

void SampleTable::insert(std::uint64_t row_id, const SampleRow& row, std::int64_t created_ms) {
  sqlite::run(insert_, row_id, row.device, row.group, row.seq, created_ms, as_bytes(row.content),
              static_cast<std::int64_t>(row.format));
}

std::vector<SampleStreams::Row> SampleTable::delete_oldest(std::uint64_t excess,
                                                           std::int64_t older_than_ms) {
  std::vector<SampleStreams::Row> gone;
  std::uint64_t freed = 0;
  sqlite::each(oldest_, [&](const SQLite::Statement& row) {
    // Row ids rise with time: the first row that is young enough ends the search.
    if (freed >= excess && number(row, 3) >= older_than_ms) return false;
    const std::uint64_t cost = from_sql(number(row, 4)) + SampleRow::kOverhead;
    gone.push_back(
        {from_sql(number(row, 0)), {std::string(text(row, 1)), std::string(text(row, 2))}, cost});
    freed += cost;
    return true;
  });
  for (const SampleStreams::Row& row : gone) remove(row.row_id);
  return gone;
}

void SampleTable::each_of(const StreamKey& stream, const Skip& skip, const Take& take) {
  sqlite::each(
      stream_,
      [&](const SQLite::Statement& row) {
        const std::uint64_t row_id = from_sql(number(row, 0));
        return skip(row_id) || take(row_id, row_format(number(row, 2)), text(row, 1));
      },
      stream.first, stream.second);
}

void SampleTable::each_stream(const std::function<void(const Sum& sum)>& take) {
  SQLite::Statement groups(
      database_,
      "SELECT device, grp, count(*), sum(length(CAST(row AS BLOB))), min(id), max(id)"
      " FROM samples GROUP BY device, grp");
  sqlite::each(groups, [&take](const SQLite::Statement& row) {
    const std::uint64_t rows = from_sql(number(row, 2));
    take({{std::string(text(row, 0)), std::string(text(row, 1))},
          rows,
          from_sql(number(row, 3)) + rows * SampleRow::kOverhead,
          from_sql(number(row, 4)),
          from_sql(number(row, 5))});
  });
}

void SampleTable::move_times(std::int64_t by_ms, std::uint64_t from_row_id) {
  SQLite::Statement move(database_, "UPDATE samples SET created_ms = created_ms + ? WHERE id >= ?");
  sqlite::run(move, by_ms, from_row_id);
}

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
