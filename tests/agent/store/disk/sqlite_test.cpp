#include "agent/store/disk/sqlite.h"

#include <gtest/gtest.h>

#include "tests/support/scratch.h"

namespace fxagent {
namespace {

TEST(Migration, StepsRunOnceInTheirOrderAndAFailedOneLeavesNothing) {
  const test::Scratch scratch;
  SQLite::Database database = sqlite::open(scratch.path("x.db"));
  const char* first[] = {"CREATE TABLE t(a); INSERT INTO t VALUES(1)"};
  ASSERT_NO_THROW(sqlite::migrate(database, 5, first));
  const char* broken[] = {first[0], "INSERT INTO t VALUES(2); no SQL"};
  EXPECT_THROW(sqlite::migrate(database, 5, broken), SQLite::Exception);
  EXPECT_EQ(database.execAndGet("SELECT sum(a) FROM t").getInt64(), 1);
  const char* second[] = {first[0], "ALTER TABLE t ADD b DEFAULT 7; UPDATE t SET a = 3"};
  ASSERT_NO_THROW(sqlite::migrate(database, 5, second));
  ASSERT_NO_THROW(sqlite::migrate(database, 5, second));
  EXPECT_EQ(database.execAndGet("SELECT sum(a + b) FROM t").getInt64(), 10);
  EXPECT_EQ(database.execAndGet("PRAGMA user_version").getInt64(), 6);
  EXPECT_EQ(sqlite::attempt([&] { sqlite::migrate(database, 5, first); }).value().code,
            SQLITE_SCHEMA);
  EXPECT_EQ(sqlite::attempt([&] { sqlite::migrate(database, 7, first); }).value().code,
            SQLITE_SCHEMA);
}

TEST(Sqlite, ValuesComeBackAsTheyWereBound) {
  SQLite::Database database = sqlite::open(":memory:");
  database.exec("CREATE TABLE t(number, text, bytes)");
  SQLite::Statement insert(database, "INSERT INTO t VALUES(?, ?, ?)");
  const std::string with_nul("a\0b", 3);
  const Bytes some{0, 255};
  EXPECT_EQ(sqlite::run(insert, std::uint64_t{0xFFFFFFFFFFFFFFFF}, with_nul, ByteView(some)), 1);
  EXPECT_EQ(sqlite::run(insert, -1, std::string(), ByteView()), 1);
  SQLite::Statement all(database, "SELECT number, text, bytes, typeof(bytes) FROM t");
  int rows = 0;
  sqlite::each(all, [&](const SQLite::Statement& row) {
    ++rows;
    EXPECT_EQ(sqlite::from_sql(sqlite::number(row, 0)), 0xFFFFFFFFFFFFFFFF);
    EXPECT_EQ(sqlite::text(row, 1), rows == 1 ? with_nul : std::string());
    EXPECT_EQ(sqlite::bytes(row, 2).size(), rows == 1 ? some.size() : 0U);
    EXPECT_EQ(sqlite::text(row, 3), "blob") << "empty bytes are not NULL";
  });
  EXPECT_EQ(rows, 2);
}

TEST(Sqlite, ReadingThatEndsEarlyLeavesTheStatementReadyAndTheDatabaseFree) {
  SQLite::Database database = sqlite::open(":memory:");
  database.exec("CREATE TABLE t(n); INSERT INTO t VALUES(1), (2), (3)");
  SQLite::Statement all(database, "SELECT n FROM t WHERE n > ?");
  std::int64_t sum = 0;
  const auto take_one = [&](const SQLite::Statement& row) {
    sum += sqlite::number(row, 0);
    return false;
  };
  sqlite::each(all, take_one, 0);
  sqlite::each(all, take_one, 1);
  EXPECT_EQ(sum, 3);
  EXPECT_NO_THROW(database.exec("DROP TABLE t")) << "no statement is in the middle of it";
}

TEST(Sqlite, FaultHasThePrimaryCodeAndTheTextOfSqlite) {
  const auto none = sqlite::attempt([] {});
  EXPECT_FALSE(none);
  SQLite::Database database = sqlite::open(":memory:");
  database.exec("CREATE TABLE t(n PRIMARY KEY); INSERT INTO t VALUES(1)");
  SQLite::Statement insert(database, "INSERT INTO t VALUES(?)");
  const auto fault = sqlite::attempt([&] { sqlite::run(insert, 1); }).value();
  EXPECT_EQ(fault.code, SQLITE_CONSTRAINT);
  EXPECT_EQ(fault.text, "UNIQUE constraint failed: t.n");
  EXPECT_EQ(sqlite::run(insert, 2), 1) << "the statement can be used again";
  EXPECT_EQ(sqlite::attempt([] { sqlite::open("/nowhere/x.db"); }).value().code, SQLITE_CANTOPEN);
}

}  // namespace
}  // namespace fxagent
