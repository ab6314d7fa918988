#include "agent/store/disk/sqlite.h"

#include <algorithm>

namespace fxagent::sqlite {

SQLite::Database open(const std::string& path) {
  return {path, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE | SQLite::OPEN_NOMUTEX};
}

SQLite::Database open_read_only(const std::string& path) {
  std::string uri = "file:";
  for (const char each : path) {
    if (each == '%')
      uri += "%25";
    else if (each == '?')
      uri += "%3f";
    else if (each == '#')
      uri += "%23";
    else
      uri += each;
  }
  const auto open = [](const std::string& name) {
    SQLite::Database database(name,
                              SQLite::OPEN_READONLY | SQLite::OPEN_URI | SQLite::OPEN_NOMUTEX);
    database.execAndGet("PRAGMA schema_version");  // the first read opens the WAL
    return database;
  };
  try {
    return open(uri);
  } catch (const SQLite::Exception& thrown) {
    // Another process writes to it.
    if ((thrown.getErrorCode() & 0xFF) == SQLITE_BUSY) throw;
  }
  // SQLite cannot make the index of a WAL here. It reads an immutable file without the WAL.
  return open(uri + "?immutable=1");
}

ByteView bytes(const SQLite::Statement& row, int column) {
  const SQLite::Column found = row.getColumn(column);
  const auto* data = static_cast<const std::uint8_t*>(found.getBlob());
  const int size = found.getBytes();
  return data == nullptr ? ByteView{} : ByteView{data, static_cast<std::size_t>(size)};
}

std::string_view text(const SQLite::Statement& row, int column) {
  const ByteView all = bytes(row, column);
  return {reinterpret_cast<const char*>(all.data()), all.size()};
}

void bind(SQLite::Statement& statement, int position, ByteView value) {
  // A null pointer would bind NULL instead of an empty blob.
  const void* data = value.empty() ? static_cast<const void*>("") : value.data();
  statement.bind(position, data, static_cast<int>(value.size()));
}

void migrate(SQLite::Database& database, std::int64_t first, std::span<const char* const> steps) {
  const std::int64_t newest = first + std::ssize(steps) - 1;
  std::int64_t version = database.execAndGet("PRAGMA user_version").getInt64();
  const bool is_newer = version > newest;
  if (is_newer || (version != 0 && version < first))
    throw SQLite::Exception(
        std::string(is_newer ? "a newer version of the agent" : "an agent from before 0.1.0") +
            " wrote it: format " + std::to_string(version) + ", this one reads " +
            std::to_string(first) + " to " + std::to_string(newest) +
            "; nothing in it is lost, and the agent that wrote it can still send it",
        SQLITE_SCHEMA);
  for (version = std::max(version, first - 1); version < newest; ++version) {
    SQLite::Transaction transaction(database, SQLite::TransactionBehavior::IMMEDIATE);
    database.exec(steps[static_cast<std::size_t>(version + 1 - first)]);
    database.exec("PRAGMA user_version = " + std::to_string(version + 1));
    transaction.commit();
  }
}

void check_schema(SQLite::Database& database, std::int64_t first,
                  std::span<const char* const> steps) {
  SQLite::Database model = open(":memory:");
  migrate(model, first, steps);
  SQLite::Statement wanted(model, "SELECT name, sql FROM sqlite_master WHERE sql IS NOT NULL");
  SQLite::Statement found(database, "SELECT sql FROM sqlite_master WHERE name = ?");
  each(wanted, [&](const SQLite::Statement& part) {
    const std::string name(text(part, 0));
    bool is_there = false;
    each(
        found, [&](const SQLite::Statement& row) { is_there = text(row, 0) == text(part, 1); },
        name);
    if (!is_there) throw SQLite::Exception(name + " was changed", SQLITE_SCHEMA);
  });
}

}  // namespace fxagent::sqlite
