#include "agent/store/samples/sample_table.h"

#include <string>

namespace fxagent {
namespace {

using sqlite::from_sql;
using sqlite::number;
using sqlite::text;

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

}  // namespace fxagent
