// Additions to SQLiteCpp: unsigned 64-bit values, texts and blobs as they lie in a row, running a
// statement in one call, faults as values, schema migration. Connections, statements and
// transactions are SQLiteCpp's own. SQLite::Exception never leaves the store: StoreDisk and
// attempt() catch it. Independent of samples and commands. One thread at a time.
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>
#include <sqlite3.h>

#include <concepts>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

#include "protocol/value/bytes.h"

namespace fxagent::sqlite {

/// A fault of SQLite: its primary result code (SQLITE_FULL …) and text.
struct Fault {
  int code = SQLITE_OK;
  std::string text;
};

/// Runs `work`. Returns nullopt if it succeeds, else the fault that SQLite threw.
template <class Work>
std::optional<Fault> attempt(Work&& work) {
  try {
    work();
    return std::nullopt;
  } catch (const SQLite::Exception& thrown) {
    return Fault{thrown.getErrorCode() & 0xFF, thrown.what()};
  }
}

/// Opens the file, or creates it. Throws SQLite::Exception.
SQLite::Database open(const std::string& path);
/// Opens an existing file only to read it, also on a disk that refuses every write. If the file has
/// a WAL without its index there, reads it without the WAL. Throws SQLite::Exception.
SQLite::Database open_read_only(const std::string& path);

/// SQLite has only signed numbers. Returns the same 64 bits.
inline std::uint64_t from_sql(std::int64_t number) { return static_cast<std::uint64_t>(number); }

// ---- the current row of a statement

inline std::int64_t number(const SQLite::Statement& row, int column) {
  return row.getColumn(column).getInt64();
}
/// Valid until the next step. SQLiteCpp's own text would end at a NUL, or be a copy.
ByteView bytes(const SQLite::Statement& row, int column);
std::string_view text(const SQLite::Statement& row, int column);

// ---- running a whole statement

template <std::integral Number>
void bind(SQLite::Statement& statement, int position, Number value) {
  statement.bind(position, static_cast<std::int64_t>(value));
}
inline void bind(SQLite::Statement& statement, int position, const std::string& value) {
  statement.bind(position, value);
}
void bind(SQLite::Statement& statement, int position, ByteView value);

/// Resets a statement at the end of its scope. An unfinished one would hold back checkpoints.
class ResetAtEnd final {
 public:
  explicit ResetAtEnd(SQLite::Statement& statement) : statement_(statement) {}
  ~ResetAtEnd() { statement_.tryReset(); }
  ResetAtEnd(const ResetAtEnd&) = delete;
  ResetAtEnd& operator=(const ResetAtEnd&) = delete;

 private:
  SQLite::Statement& statement_;
};

/// Runs a statement that returns no rows, with its parameters in order. Returns the number of rows
/// it has changed. Throws SQLite::Exception.
template <class... Values>
int run(SQLite::Statement& statement, const Values&... values) {
  const ResetAtEnd reset(statement);
  int position = 0;
  (bind(statement, ++position, values), ...);
  return statement.exec();
}

/// Calls `take` with each row until it returns false. A `take` that returns void gets every row.
/// Throws SQLite::Exception.
template <class Take, class... Values>
void each(SQLite::Statement& statement, Take&& take, const Values&... values) {
  const ResetAtEnd reset(statement);
  int position = 0;
  (bind(statement, ++position, values), ...);
  while (statement.executeStep()) {
    if constexpr (std::is_void_v<std::invoke_result_t<Take, const SQLite::Statement&>>)
      take(std::as_const(statement));
    else if (!take(std::as_const(statement)))
      return;
  }
}

// ---- the schema

/// Brings the schema from its `user_version` to the newest. The first step makes version `first` in
/// a new file, each later step the next version, each in its own transaction. Throws
/// SQLite::Exception if a step fails, with code SQLITE_SCHEMA if a newer program wrote the file, or
/// one from before `first`.
void migrate(SQLite::Database& database, std::int64_t first, std::span<const char* const> steps);

/// Checks that everything the steps create exists, with the same SQL. Additional tables and indexes
/// are allowed. Throws SQLite::Exception, with code SQLITE_SCHEMA if something differs.
void check_schema(SQLite::Database& database, std::int64_t first,
                  std::span<const char* const> steps);

}  // namespace fxagent::sqlite
