#include <gtest/gtest.h>

#include <filesystem>

#include "agent/store/disk/store_file.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

constexpr std::uintmax_t kFrame = 4096 + 24;  // a page in the WAL, with its header

/// A database in WAL mode that writes one more page per row than `blob` bytes need.
struct Ledger {
  test::Scratch scratch;
  std::string path = scratch.path("ledger.db");
  SQLite::Database db = sqlite::open(path);
  std::optional<Checkpointer> checkpointer;
  std::int64_t rows = 0;

  Ledger() {
    db.setBusyTimeout(60'000);  // the checkpointer may lose the processor while it holds a lock
    EXPECT_NO_THROW(
        db.exec("PRAGMA page_size = 4096; PRAGMA journal_mode = WAL; PRAGMA synchronous = OFF;"
                "CREATE TABLE t(id INTEGER PRIMARY KEY, x BLOB)"));
    checkpointer.emplace(db, path);
  }
  /// Writes at least `pages` pages, ten per commit.
  void write(int pages) {
    for (int i = 0; i < pages; i += 10, ++rows)
      ASSERT_NO_THROW(db.exec("INSERT INTO t VALUES(NULL, zeroblob(40960))"));
  }
  std::int64_t number(const char* sql) { return db.execAndGet(sql).getInt64(); }
  std::uintmax_t log_bytes() const { return std::filesystem::file_size(path + "-wal"); }
  bool is_whole() {
    return number("SELECT count(*) FROM t") == rows &&
           number("SELECT sum(length(x)) FROM t") == rows * 40960 &&
           number("SELECT count(*) FROM pragma_integrity_check WHERE integrity_check = 'ok'") == 1;
  }
};

TEST(Checkpointer, LogStaysBelowItsMostHoweverMuchIsWritten) {
  Ledger ledger;
  ledger.write(5 * Checkpointer::kMostPages);
  EXPECT_LE(ledger.log_bytes(), (Checkpointer::kMostPages + 100) * kFrame);
  EXPECT_TRUE(ledger.is_whole());
}

TEST(Checkpointer, LogIsBroughtHomeBesideTheWriter) {
  Ledger ledger;
  ledger.write(Checkpointer::kPages + 100);
  // SQLite's own checkpoints use the commit hook too, and there is only one.
  EXPECT_EQ(sqlite3_wal_hook(ledger.db.getHandle(), nullptr, nullptr), &*ledger.checkpointer);
  ledger.checkpointer.reset();  // waits for the checkpoint in progress
  // The WAL contains pages that were written twice and, at its end, pages added in the meantime.
  EXPECT_GE(std::filesystem::file_size(ledger.path),
            std::uintmax_t{Checkpointer::kPages} * 4096 / 2);
}

// The files of a running agent are moved away, and another program creates new ones with their
// names.
TEST(Checkpointer, FilesThatTookThePlaceOfItsOwnAreNotItsBusiness) {
  Ledger ledger;
  ledger.write(100);
  for (const char* suffix : {"", "-wal", "-shm"})
    std::filesystem::rename(ledger.path + suffix, ledger.scratch.path("moved.db") + suffix);
  SQLite::Database other = sqlite::open(ledger.path);
  ASSERT_NO_THROW(
      other.exec("PRAGMA journal_mode = WAL; CREATE TABLE other(x);"
                 "INSERT INTO other VALUES(zeroblob(2000000))"));
  ledger.write(2 * Checkpointer::kPages);
  ledger.checkpointer.reset();
  EXPECT_TRUE(ledger.is_whole());
  EXPECT_EQ(other.execAndGet("SELECT count(*) FROM other").getInt64(), 1);
}

TEST(Checkpointer, ReaderThatHoldsTheLogBackHoldsNobodyUp) {
  Ledger ledger;
  ledger.write(10);
  SQLite::Database reader = sqlite::open(ledger.path);
  ASSERT_NO_THROW(reader.exec("BEGIN"));
  ASSERT_EQ(reader.execAndGet("SELECT count(*) FROM t").getInt64(), ledger.rows);
  ledger.write(2 * Checkpointer::kMostPages);
  EXPECT_GT(ledger.log_bytes(), 2 * Checkpointer::kMostPages * kFrame);
  ASSERT_NO_THROW(reader.exec("COMMIT"));
  ledger.write(100);
  const std::uintmax_t grown = ledger.log_bytes();
  ledger.write(Checkpointer::kPages);
  EXPECT_EQ(ledger.log_bytes(), grown);  // wraps around to its start
  EXPECT_TRUE(ledger.is_whole());
}

}  // namespace
}  // namespace fxagent
