// The rows of samples in the store's file. Starts no transaction of its own. Every call may throw
// SQLite::Exception. The store's thread.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string_view>
#include <vector>

#include "agent/store/disk/sqlite.h"
#include "agent/store/samples/history.h"
#include "agent/store/samples/sample_streams.h"

namespace fxagent {

class SampleTable final {
 public:
  /// `database` has the schema and outlives the table.
  explicit SampleTable(SQLite::Database& database);

  /// Writes `row` under `row_id`, which is higher than any before.
  void insert(std::uint64_t row_id, const SampleRow& row, std::int64_t created_ms);
  void remove(std::uint64_t row_id) { sqlite::run(remove_, row_id); }
  /// Deletes the oldest rows until `excess` bytes are free and no row is older than
  /// `older_than_ms`. Returns them.
  std::vector<SampleStreams::Row> delete_oldest(std::uint64_t excess, std::int64_t older_than_ms);

  using Skip = std::function<bool(std::uint64_t row_id)>;
  using Take = std::function<bool(std::uint64_t row_id, std::optional<RowFormat> format,
                                  std::string_view content)>;
  /// Calls `take` with each row of the stream in its order, except those for which `skip` returns
  /// true, until it returns false.
  void each_of(const StreamKey& stream, const Skip& skip, const Take& take);

  /// The rows of one stream, and the lowest and highest of their ids.
  struct Sum {
    StreamKey stream;
    std::uint64_t rows = 0;
    std::uint64_t cost = 0;
    std::uint64_t oldest = 0;
    std::uint64_t newest = 0;
  };
  /// Calls `take` with the rows of each stream.
  void each_stream(const std::function<void(const Sum& sum)>& take);

  /// Shifts the times of rows with an id from `from_row_id`.
  void move_times(std::int64_t by_ms, std::uint64_t from_row_id);

 private:
  SQLite::Database& database_;
  SQLite::Statement insert_;
  SQLite::Statement remove_;
  SQLite::Statement stream_;
  SQLite::Statement oldest_;
};

}  // namespace fxagent
