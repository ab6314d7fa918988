#include "agent/store/store.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>

#include "tests/agent/store/power_cut.h"
#include "tests/agent/store/shelf.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using namespace test;

TEST(Store, FilesAreTheOwnersAlone) {
  OpenShelf shelf;
  struct stat facts {};
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(shelf.config.path)) {
    ASSERT_EQ(::stat(entry.path().c_str(), &facts), 0);
    EXPECT_EQ(facts.st_mode & 0777, 0600U) << entry.path();
    ++files;
  }
  EXPECT_EQ(files, 5U);  // the database, its WAL and the WAL's index; the lock; the marks
  ASSERT_EQ(::stat(shelf.config.path.c_str(), &facts), 0);
  EXPECT_EQ(facts.st_mode & 0777, 0700U);
}

TEST(Store, DamagedFileIsSetAsideAndAFreshOneBegun) {
  Shelf shelf;
  std::filesystem::create_directories(shelf.config.path);
  std::ofstream(shelf.file()) << std::string(8192, 'x');
  shelf.open();
  EXPECT_EQ(shelf.store->state(), "disk");
  EXPECT_TRUE(std::filesystem::exists(shelf.file() + ".corrupt-" + std::to_string(kNow)));
  EXPECT_TRUE(shelf.add(rows(1, 1)));
  EXPECT_EQ(shelf.drain(), "a/fast[1]}");
}

TEST(Store, DamageInTheMiddleOfTheFileIsFoundAtTheStart) {
  OpenShelf shelf;
  shelf.add(rows(1, 2000));
  shelf.store->close();
  {
    std::fstream file(shelf.file(), std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(4096 * 3);
    file << std::string(4096 * 12, '\xA5');
  }
  shelf.open();
  EXPECT_EQ(shelf.store->state(), "disk");
  EXPECT_EQ(shelf.store->samples().rows(), 0U);
  EXPECT_TRUE(std::filesystem::exists(shelf.file() + ".corrupt-" + std::to_string(kNow)));
}

TEST(Store, FileOfANewerProgramIsSetAside) {
  Shelf shelf;
  shelf.open().close();
  {
    SQLite::Database database = sqlite::open(shelf.file());
    ASSERT_NO_THROW(database.exec("PRAGMA user_version = 99"));
  }
  EXPECT_EQ(shelf.open().state(), "disk");
  EXPECT_TRUE(std::filesystem::exists(shelf.file() + ".corrupt-" + std::to_string(kNow)));
}

TEST(Store, DirectoryThatCannotBeMadeIsTriedAgain) {
  ShelfWithoutDisk shelf;
  EXPECT_EQ(shelf.store->state(), "memory");
  EXPECT_FALSE(shelf.add(rows(1, 1)));
  EXPECT_FALSE(shelf.journal(entry("x")));
  EXPECT_EQ(shelf.begin(), static_cast<std::uint64_t>(kNow));
  shelf.store->upkeep(kStart, kNow);
  std::filesystem::remove(shelf.config.path);
  shelf.store->upkeep(kStart + 9s, kNow);
  EXPECT_EQ(shelf.store->state(), "memory");
  shelf.store->upkeep(kStart + 10s, kNow);
  EXPECT_EQ(shelf.store->state(), "disk");
  EXPECT_TRUE(shelf.add(rows(1, 1)));
}

TEST(Store, JournalReportsThatTheCommandsOfADeviceCouldNotBeRead) {
  PowerCut disk;
  OpenShelf shelf;
  shelf.record_acknowledged(shelf.arrived("known", "{}"));
  shelf.open();
  StoredJournal& journal = shelf.store->journal();
  disk.set_failing(true);
  EXPECT_TRUE(journal.known_ids("a").empty());
  EXPECT_FALSE(journal.was_read());
  disk.set_failing(false);
  EXPECT_EQ(journal.known_ids("a").size(), 1U);
  EXPECT_TRUE(journal.was_read());
}

TEST(Store, CommandsThatCouldNotBeReadAtTheStartAreFoundLater) {
  PowerCut disk;
  OpenShelf shelf;
  shelf.record_acknowledged(shelf.arrived("known", "{}"));
  ASSERT_TRUE(shelf.journal(shelf.arrived("interrupted")));
  shelf.open();
  disk.set_failing(true);
  EXPECT_TRUE(shelf.store->journal().known_ids().empty());
  EXPECT_EQ(shelf.store->state(), "memory");
  shelf.store->upkeep(kStart, kNow);
  shelf.store->upkeep(kStart + 10s, kNow);
  EXPECT_FALSE(shelf.store->take_found_late());
  EXPECT_FALSE(shelf.journal(shelf.arrived("of this run")));
  disk.set_failing(false);
  EXPECT_TRUE(shelf.store->journal().unacknowledged().empty()) << "until it is read again";
  shelf.store->upkeep(kStart + 20s, kNow);
  EXPECT_EQ(shelf.store->state(), "disk");
  const auto late = shelf.store->take_found_late();
  ASSERT_TRUE(late);
  ASSERT_EQ(late->ids.size(), 1U);
  EXPECT_EQ(late->ids[0].id, "known");
  ASSERT_EQ(late->unacknowledged.size(), 1U);
  EXPECT_EQ(late->unacknowledged[0].id, "interrupted");
  EXPECT_TRUE(late->numbers.empty());
  shelf.store->upkeep(kStart + 30s, kNow);
  EXPECT_FALSE(shelf.store->take_found_late());
  EXPECT_TRUE(shelf.found("of this run"));
}

TEST(Store, SecondAgentDoesNotGetTheSameFile) {
  OpenShelf shelf;
  const Store second(shelf.config, kNow);
  EXPECT_EQ(second.state(), "memory");
  EXPECT_EQ(shelf.store->state(), "disk");
}

/// The schema of the program's first version.
constexpr const char* kFirstSchema =
    "CREATE TABLE samples(id INTEGER PRIMARY KEY, device TEXT NOT NULL, grp TEXT NOT NULL,"
    " seq INTEGER NOT NULL, created_ms INTEGER NOT NULL, row TEXT NOT NULL);"
    "CREATE INDEX samples_by_lane ON samples(device, grp, seq, id);"
    "CREATE TABLE devices(name TEXT PRIMARY KEY, last_seq INTEGER NOT NULL,"
    " clean INTEGER NOT NULL) WITHOUT ROWID;"
    "CREATE TABLE orders(device TEXT NOT NULL, id TEXT NOT NULL, received_ms INTEGER NOT NULL,"
    " deadline_ms INTEGER NOT NULL, op TEXT NOT NULL, response_topic TEXT NOT NULL,"
    " correlation BLOB NOT NULL, result TEXT NOT NULL, told INTEGER NOT NULL,"
    " PRIMARY KEY(device, id)) WITHOUT ROWID;"
    "CREATE INDEX orders_by_age ON orders(device, received_ms);"
    "PRAGMA user_version = 1;"
    "INSERT INTO samples VALUES(1, 'a', 'fast', 5, 1790000000000, '5');"
    "INSERT INTO devices VALUES('a', 5, 1);"
    "INSERT INTO orders VALUES('a', 'done', 1790000000000, 1790000010000, 'write', '', x'01',"
    " '{1}', 1);"
    "INSERT INTO orders VALUES('a', 'open', 1790000000001, 1790000010000, 'write', '', x'',"
    " '', 0);";

TEST(Store, FileOfTheFirstVersionIsTakenOver) {
  Shelf shelf;
  std::filesystem::create_directories(shelf.config.path);
  {
    SQLite::Database old = sqlite::open(shelf.file());
    ASSERT_NO_THROW(old.exec("PRAGMA journal_mode = WAL"));
    ASSERT_NO_THROW(old.exec(kFirstSchema));
  }
  shelf.open();
  EXPECT_EQ(shelf.store->state(), "disk");
  EXPECT_EQ(shelf.store->set_aside(), "");
  EXPECT_EQ(shelf.begin(), 5U);
  ASSERT_EQ(shelf.store->journal().known_ids().size(), 1U);
  const auto known = shelf.found(shelf.store->journal().known_ids()[0].id);
  EXPECT_EQ(known->result, "{1}");
  EXPECT_EQ(known->correlation, Bytes{1});
  EXPECT_TRUE(known->acknowledged);
  ASSERT_EQ(shelf.store->journal().unacknowledged().size(), 1U);
  JournalEntry result = shelf.store->journal().unacknowledged()[0];
  EXPECT_EQ(result.number, 0U);
  EXPECT_EQ(shelf.drain(), "a/fast[5]}");
  result.result = "{2}";
  result.audit = told("open");
  shelf.record(result);
  EXPECT_EQ(audit_of(shelf).size(), 1U);
  EXPECT_EQ(shelf.open().journal().unacknowledged().at(0).result, "{2}");
}

}  // namespace
}  // namespace fxagent
