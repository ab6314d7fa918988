// SQLite's C API behind types that clean up after themselves. Knows no samples and no commands.
// One thread at a time.
#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "protocol/bytes.h"

namespace fxagent::sqlite {

/// What SQLite said last: a primary result code (SQLITE_FULL …) and its text.
struct Fault {
  int code = SQLITE_OK;
  std::string text;
};

class Database;

/// SQLite has no unsigned numbers: the same 64 bits.
inline std::int64_t to_sql(std::uint64_t number) { return static_cast<std::int64_t>(number); }
inline std::uint64_t from_sql(std::int64_t number) { return static_cast<std::uint64_t>(number); }

/// One prepared statement. It may be invalid, where the database was unusable: then every step
/// fails. The database outlives it.
class Statement final {
 public:
  enum class Step : std::uint8_t { row, done, failed };

  Statement() = default;
  Statement(Database& database, std::string_view sql);

  /// Parameters by position, from 1; text is copied.
  Statement& bind(int position, std::int64_t number);
  Statement& bind(int position, std::string_view text);
  Statement& bind(int position, ByteView bytes);
  /// The next row, or the end. A statement that has come to its end begins anew with what is bound.
  Step step();
  /// For a statement without rows: whether it was carried out.
  bool run() { return step() == Step::done; }
  void reset();

  std::int64_t number(int column) const { return sqlite3_column_int64(statement_.get(), column); }
  /// Valid until the next step.
  std::string_view text(int column) const;
  ByteView bytes(int column) const;
  bool is_null(int column) const {
    return sqlite3_column_type(statement_.get(), column) == SQLITE_NULL;
  }

 private:
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
  };
  void note_bound(int code);
  Database* database_ = nullptr;
  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  bool bound_ = true;  ///< all that was to be, since the last step
};

class Database final {
 public:
  enum class Access : std::uint8_t { read_write, read_only };
  /// Opens the file, and creates it where it may be written; on failure is_open() is false and
  /// fault() says why.
  explicit Database(const std::string& path, Access access = Access::read_write);
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  bool is_open() const { return connection_ != nullptr; }
  /// Statements without results, one after the other.
  bool execute(const char* sql);
  /// The first column of the first row; 0 where there is none.
  std::int64_t number(const char* sql);
  /// Rows that the last statement has changed.
  std::int64_t changes() const { return sqlite3_changes64(connection_.get()); }

  /// The last failure since clear_fault().
  const Fault& fault() const { return fault_; }
  void clear_fault() { fault_ = {}; }
  void note_fault();
  void set_fault(Fault fault) { fault_ = std::move(fault); }
  sqlite3* handle() const { return connection_.get(); }

 private:
  struct Close {
    // v2: a statement that is still there keeps the connection until it goes, too.
    void operator()(sqlite3* connection) const { sqlite3_close_v2(connection); }
  };
  std::unique_ptr<sqlite3, Close> connection_;
  Fault fault_;
};

/// All or nothing: what was not committed is rolled back.
class Transaction final {
 public:
  explicit Transaction(Database& database);
  ~Transaction();
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;

  bool begun() const { return open_; }
  /// False: nothing of it was kept.
  bool commit();

 private:
  Database& database_;
  bool open_ = false;
};

/// Brings the schema from its `user_version` to the newest: step i leads from version i to i + 1,
/// each in a transaction of its own. False where one failed, or where the file is of a newer
/// program; then fault() says which.
bool migrate(Database& database, std::span<const char* const> steps);

/// Whether all that the steps make is there, as they make it; more may be there. Where it is not,
/// fault() says so, with SQLITE_SCHEMA if it could be read.
bool has_schema(Database& database, std::span<const char* const> steps);

}  // namespace fxagent::sqlite
