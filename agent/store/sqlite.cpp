#include "agent/store/sqlite.h"

namespace fxagent::sqlite {

Statement::Statement(Database& database, std::string_view sql) : database_(&database) {
  sqlite3_stmt* statement = nullptr;
  if (!database.is_open() ||
      sqlite3_prepare_v3(database.handle(), sql.data(), static_cast<int>(sql.size()),
                         SQLITE_PREPARE_PERSISTENT, &statement, nullptr) != SQLITE_OK)
    database.note_fault();
  statement_.reset(statement);
}

Statement& Statement::bind(int position, std::int64_t number) {
  note_bound(sqlite3_bind_int64(statement_.get(), position, number));
  return *this;
}

Statement& Statement::bind(int position, std::string_view text) {
  note_bound(sqlite3_bind_text64(statement_.get(), position,
                                 text.data() != nullptr ? text.data() : "", text.size(),
                                 SQLITE_TRANSIENT, SQLITE_UTF8));
  return *this;
}

Statement& Statement::bind(int position, ByteView bytes) {
  note_bound(bytes.empty() ? sqlite3_bind_zeroblob(statement_.get(), position, 0)
                           : sqlite3_bind_blob64(statement_.get(), position, bytes.data(),
                                                 bytes.size(), SQLITE_TRANSIENT));
  return *this;
}

/// What could not be bound would be NULL.
void Statement::note_bound(int code) {
  if (code == SQLITE_OK || statement_ == nullptr) return;
  if (std::exchange(bound_, false)) database_->note_fault();
}

Statement::Step Statement::step() {
  if (statement_ == nullptr || !std::exchange(bound_, true)) return Step::failed;
  switch (sqlite3_step(statement_.get())) {
    case SQLITE_ROW:
      return Step::row;
    case SQLITE_DONE:
      reset();
      return Step::done;
    default:
      database_->note_fault();
      reset();
      return Step::failed;
  }
}

void Statement::reset() {
  if (statement_ != nullptr) sqlite3_reset(statement_.get());
}

std::string_view Statement::text(int column) const {
  const ByteView all = bytes(column);
  return {reinterpret_cast<const char*>(all.data()), all.size()};
}

ByteView Statement::bytes(int column) const {
  const auto* data =
      static_cast<const std::uint8_t*>(sqlite3_column_blob(statement_.get(), column));
  const int size = sqlite3_column_bytes(statement_.get(), column);
  return data == nullptr ? ByteView{} : ByteView{data, static_cast<std::size_t>(size)};
}

Database::Database(const std::string& path, Access access) {
  sqlite3* connection = nullptr;
  const int way = access == Access::read_only ? SQLITE_OPEN_READONLY
                                              : SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE;
  const int code = sqlite3_open_v2(path.c_str(), &connection, way | SQLITE_OPEN_NOMUTEX, nullptr);
  connection_.reset(connection);
  if (code == SQLITE_OK) return;
  note_fault();
  connection_.reset();
}

bool Database::execute(const char* sql) {
  if (is_open() && sqlite3_exec(connection_.get(), sql, nullptr, nullptr, nullptr) == SQLITE_OK)
    return true;
  note_fault();
  return false;
}

std::int64_t Database::number(const char* sql) {
  Statement statement(*this, sql);
  return statement.step() == Statement::Step::row ? statement.number(0) : 0;
}

void Database::note_fault() {
  if (connection_ == nullptr) {
    if (fault_.code == SQLITE_OK) fault_ = {SQLITE_CANTOPEN, "it is not open"};
    return;
  }
  fault_ = {sqlite3_errcode(connection_.get()) & 0xFF, sqlite3_errmsg(connection_.get())};
}

Transaction::Transaction(Database& database)
    : database_(database), open_(database.execute("BEGIN IMMEDIATE")) {}

Transaction::~Transaction() {
  if (!open_ || sqlite3_get_autocommit(database_.handle()) != 0) return;
  sqlite3_exec(database_.handle(), "ROLLBACK", nullptr, nullptr, nullptr);
}

bool Transaction::commit() {
  if (!open_ || !database_.execute("COMMIT")) return false;
  open_ = false;
  return true;
}

bool migrate(Database& database, std::span<const char* const> steps) {
  const std::int64_t newest = static_cast<std::int64_t>(steps.size());
  database.clear_fault();
  std::int64_t version = database.number("PRAGMA user_version");
  if (database.fault().code != SQLITE_OK) return false;
  if (version > newest) {
    database.set_fault({SQLITE_SCHEMA, "it is of a newer program: version " +
                                           std::to_string(version) + ", known up to " +
                                           std::to_string(newest)});
    return false;
  }
  for (; version < newest; ++version) {
    Transaction transaction(database);
    const std::string mark = "PRAGMA user_version = " + std::to_string(version + 1);
    if (!transaction.begun() || !database.execute(steps[static_cast<std::size_t>(version)]) ||
        !database.execute(mark.c_str()) || !transaction.commit())
      return false;
  }
  return true;
}

bool has_schema(Database& database, std::span<const char* const> steps) {
  Database model(":memory:");
  if (!migrate(model, steps)) {
    database.set_fault(model.fault());
    return false;
  }
  database.clear_fault();
  Statement wanted(model, "SELECT name, sql FROM sqlite_master WHERE sql IS NOT NULL");
  Statement found(database, "SELECT sql FROM sqlite_master WHERE name = ?");
  while (wanted.step() == Statement::Step::row) {
    const bool is_there = found.bind(1, wanted.text(0)).step() == Statement::Step::row &&
                          found.text(0) == wanted.text(1);
    found.reset();
    if (is_there) continue;
    if (database.fault().code == SQLITE_OK)
      database.set_fault({SQLITE_SCHEMA, std::string(wanted.text(0)) + " is not as it was made"});
    return false;
  }
  return true;
}

}  // namespace fxagent::sqlite
