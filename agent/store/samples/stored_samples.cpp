#include "agent/store/samples/stored_samples.h"

#include <algorithm>
#include <chrono>
#include <string_view>
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
                       {"device", stream.device},
                       {"group", stream.group},
                       {"rows_dropped", std::to_string(rows)}});
}

}  // namespace

StoredSamples::Statements::Statements(SQLite::Database& database)
    : insert(database, "INSERT INTO samples VALUES(?, ?, ?, ?, ?, ?, 1)"),
      remove(database, "DELETE FROM samples WHERE id = ?"),
      stream(database, "SELECT id, row FROM samples WHERE device = ? AND grp = ? ORDER BY seq, id"),
      oldest(database,
             "SELECT id, device, grp, created_ms, length(CAST(row AS BLOB)) FROM samples"
             " ORDER BY id") {}

void StoredSamples::load(SQLite::Database& database) {
  removed_.clear();
  streams_.clear();
  sql_.emplace(database);
  SQLite::Statement groups(
      database,
      "SELECT device, grp, count(*), sum(length(CAST(row AS BLOB))), min(id), max(id)"
      " FROM samples GROUP BY device, grp");
  sqlite::each(groups, [this](const SQLite::Statement& row) {
    const std::uint64_t rows = from_sql(number(row, 2));
    recovered_ += rows;
    streams_.found({std::string(text(row, 0)), std::string(text(row, 1))}, rows,
                   from_sql(number(row, 3)) + rows * SampleRow::kOverhead,
                   from_sql(number(row, 4)));
    next_row_id_ = std::max(next_row_id_, from_sql(number(row, 5)) + 1);
  });
}

void StoredSamples::unload(Rows rows) {
  sql_.reset();
  if (rows == Rows::kept) return;
  if (rows == Rows::unread) recovered_ -= streams_.rows();
  removed_.clear();
  for (const auto& [device, count] : streams_.clear())
    if (rows == Rows::lost) count_dropped(device, count, StoreLimit::none);
}

bool StoredSamples::write_pending(std::size_t /*at_most*/) {
  for (const std::uint64_t row_id : removed_) sqlite::run(sql_->remove, row_id);
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
    disk_.write_pending();
    std::uint64_t added = 0;
    std::uint64_t row_id = next_row_id_;
    std::map<std::string, std::uint64_t> highest;
    for (const SampleRow& row : rows) {
      added += row.cost();
      highest[row.stream.device] = std::max(highest[row.stream.device], row.seq);
      sqlite::run(sql_->insert, row_id++, row.stream.device, row.stream.group, row.seq,
                  disk_.utc_ms(), as_bytes(row.content));
    }
    numbers_.write_with_samples(highest);
    const std::uint64_t full = streams_.bytes() + added + journal_.bytes_in_commit();
    if (full > config_.max_bytes) gone = delete_oldest(full - config_.max_bytes, 0);
  });
  if (!written) {
    numbers_.refused();
    return false;
  }
  for (SampleRow& row : rows) {
    row.row_id = next_row_id_++;
    const SampleStreams::Row stored{row.row_id, row.stream, row.cost()};
    streams_.added(stored);
    if (hold == Hold::yes) streams_.take(stored);
  }
  forget(gone, StoreLimit::max_bytes);
  failpoint("sample_stored");
  return true;
}

std::vector<SampleStreams::Row> StoredSamples::delete_oldest(std::uint64_t excess,
                                                             std::int64_t older_than_ms) {
  std::vector<SampleStreams::Row> gone;
  std::uint64_t freed = 0;
  sqlite::each(sql_->oldest, [&](const SQLite::Statement& row) {
    // Row ids rise with time: the first row that is young enough ends the search.
    if (freed >= excess && number(row, 3) >= older_than_ms) return false;
    const std::uint64_t cost = from_sql(number(row, 4)) + SampleRow::kOverhead;
    gone.push_back(
        {from_sql(number(row, 0)), {std::string(text(row, 1)), std::string(text(row, 2))}, cost});
    freed += cost;
    return true;
  });
  for (const SampleStreams::Row& row : gone) sqlite::run(sql_->remove, row.row_id);
  return gone;
}

void StoredSamples::forget(const std::vector<SampleStreams::Row>& gone, StoreLimit limit) {
  for (const SampleStreams::Row& row : gone) {
    streams_.remove_oldest(row);
    count_dropped(row.stream.device, 1, limit);
  }
}

std::optional<HistoryBatch> StoredSamples::next(const StreamKey& key, HistoryMessage& message) {
  if (disk_.is_writable()) disk_.flush();
  if (!sql_) return std::nullopt;
  BatchBuilder builder(message);
  std::vector<SampleStreams::Row> taken;
  std::vector<SampleStreams::Row> damaged;
  const auto take = [&](const SQLite::Statement& row) {
    const std::uint64_t row_id = from_sql(number(row, 0));
    if (streams_.is_out(row_id) || removed_.contains(row_id)) return true;
    const std::string_view content = text(row, 1);
    const auto added = builder.add(row_id, content);
    if (added == BatchBuilder::Added::no_room) return false;
    (added == BatchBuilder::Added::yes ? taken : damaged)
        .push_back({row_id, key, content.size() + SampleRow::kOverhead});
    return true;
  };
  if (!disk_.attempt("read", [&] { sqlite::each(sql_->stream, take, key.device, key.group); }))
    return std::nullopt;
  for (const SampleStreams::Row& row : damaged) {
    streams_.take(row);
    count_dropped(key.device, remove(row.row_id), StoreLimit::none);
  }
  if (!damaged.empty()) log_damaged(key, damaged.size());
  if (builder.empty()) return std::nullopt;
  for (const SampleStreams::Row& row : taken) streams_.take(row);
  streams_.set_on_the_way(key, true);
  return builder.take(key);
}

std::uint64_t StoredSamples::remove(std::uint64_t row_id) {
  if (!streams_.remove(row_id)) return 0;
  removed_.insert(row_id);
  return 1;
}

std::uint64_t StoredSamples::remove(const HistoryBatch& batch) {
  streams_.set_on_the_way(batch.stream, false);
  std::uint64_t count = 0;
  for (const std::uint64_t row_id : batch.row_ids) count += remove(row_id);
  return count;
}

void StoredSamples::returned(const HistoryBatch& batch) {
  streams_.set_on_the_way(batch.stream, false);
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
  const bool done = disk_.commit("delete", [&] {
    disk_.write_pending();
    gone = delete_oldest(excess, older_than_ms);
  });
  if (done) forget(gone, excess > 0 ? StoreLimit::max_bytes : StoreLimit::max_age);
}

void StoredSamples::move_stored_times(std::int64_t by_ms) {
  SQLite::Statement move(disk_.database(),
                         "UPDATE samples SET created_ms = created_ms + ? WHERE id >= ?");
  sqlite::run(move, by_ms, first_of_run_);
}

}  // namespace fxagent
