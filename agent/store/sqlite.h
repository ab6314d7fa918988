// What SQLiteCpp leaves to its user: values of 64 bits without a sign, texts and bytes as they lie
// in a row, a whole statement in one call, a fault without an exception, and the steps of a schema.
// All else is SQLiteCpp's: connections, statements, transactions. It throws SQLite::Exception,
// which never leaves this folder. Knows no samples and no commands. One thread at a time.
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

#include "protocol/bytes.h"

namespace fxagent::sqlite {

/// What SQLite said: a primary result code (SQLITE_FULL …) and its text.
struct Fault {
  int code = SQLITE_OK;
  std::string text;
};

/// Carries out `work`. Nothing: it came to its end; else what SQLite threw.
template <class Work>
std::optional<Fault> attempt(Work&& work) {
  try {
    work();
    return std::nullopt;
  } catch (const SQLite::Exception& thrown) {
    return Fault{thrown.getErrorCode() & 0xFF, thrown.what()};
  }
}

enum class Access : std::uint8_t { read_write, read_only };
/// Opens the file, and creates it where it may be written. Throws SQLite::Exception.
SQLite::Database open(const std::string& path, Access access = Access::read_write);

/// SQLite has no unsigned numbers: the same 64 bits.
inline std::uint64_t from_sql(std::int64_t number) { return static_cast<std::uint64_t>(number); }

// ---- the row that a statement stands on

inline std::int64_t number(const SQLite::Statement& row, int column) {
  return row.getColumn(column).getInt64();
}
/// Valid until the next step. SQLiteCpp's own text would end at a NUL, or be a copy.
ByteView bytes(const SQLite::Statement& row, int column);
std::string_view text(const SQLite::Statement& row, int column);

// ---- a statement from its beginning to its end

template <std::integral Number>
void bind(SQLite::Statement& statement, int position, Number value) {
  statement.bind(position, static_cast<std::int64_t>(value));
}
void bind(SQLite::Statement& statement, int position, const std::string& value);
void bind(SQLite::Statement& statement, int position, ByteView value);

/// A statement that was left in the middle holds back checkpoints.
class ResetAtEnd final {
 public:
  explicit ResetAtEnd(SQLite::Statement& statement) : statement_(statement) {}
  ~ResetAtEnd() { statement_.tryReset(); }
  ResetAtEnd(const ResetAtEnd&) = delete;
  ResetAtEnd& operator=(const ResetAtEnd&) = delete;

 private:
  SQLite::Statement& statement_;
};

/// Carries out a statement without rows, with these parameters from the first on. Returns how many
/// rows it has changed. Throws SQLite::Exception.
template <class... Values>
int run(SQLite::Statement& statement, const Values&... values) {
  const ResetAtEnd reset(statement);
  int position = 0;
  (bind(statement, ++position, values), ...);
  return statement.exec();
}

/// Hands each row to `take`, until that returns false (it may return nothing). Throws
/// SQLite::Exception.
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

/// Brings the schema from its `user_version` to the newest: step i leads from version i to i + 1,
/// each in a transaction of its own. Throws SQLite::Exception where one failed, and with
/// SQLITE_SCHEMA where the file is of a newer program.
void migrate(SQLite::Database& database, std::span<const char* const> steps);

/// Makes sure that all that the steps make is there, as they make it; more may be there. Throws
/// SQLite::Exception, with SQLITE_SCHEMA where something is not as it was made.
void check_schema(SQLite::Database& database, std::span<const char* const> steps);

}  // namespace fxagent::sqlite
