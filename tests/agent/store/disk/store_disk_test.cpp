#include "agent/store/disk/store_disk.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/scratch.h"

namespace fxagent {
namespace {

constexpr std::int64_t kNow = 1790000000000;
using Sync = StoreDisk::Sync;

/// Writes device rows and records the calls it receives.
class Part final : public StorePart {
 public:
  void load(SQLite::Database& database) override {
    insert_.emplace(database, "INSERT INTO devices VALUES(?, ?, 0)");
    told += "load ";
  }
  void unload(Rows rows) override {
    insert_.reset();
    told += rows == Rows::kept ? "kept " : rows == Rows::lost ? "lost " : "unread ";
  }
  void set_aside(const std::string& name) override { aside = name; }
  void replaced() override { told += "replaced "; }
  bool has_pending() const override { return !waiting.empty(); }
  void begin_commit() override {
    told += "begin ";
    written_ = 0;
  }
  bool write_pending(std::size_t at_most) override {
    for (; written_ < std::min(at_most, waiting.size()); ++written_) write(waiting[written_]);
    return written_ < waiting.size();
  }
  void end_commit() override { told += "end "; }
  void committed() override {
    told += "committed ";
    waiting.erase(waiting.begin(), waiting.begin() + static_cast<std::ptrdiff_t>(written_));
    written_ = 0;
  }
  void write(int number) { sqlite::run(*insert_, std::to_string(number), number); }

  std::string told;
  std::string aside;
  std::vector<int> waiting;

 private:
  std::optional<SQLite::Statement> insert_;
  std::size_t written_ = 0;
};

struct StoreDiskParts : testing::Test {
  StoreDiskParts() {
    config.path = scratch.path("store");
    disk.emplace(config, kNow);
    disk->set_parts({&part});
    disk->open();
    EXPECT_TRUE(disk->is_writable());
    part.told.clear();
  }
  std::int64_t count() {
    return disk->database().execAndGet("SELECT count(*) FROM devices").getInt64();
  }

  test::Scratch scratch;
  StoreConfig config;
  std::optional<StoreDisk> disk;
  Part part;
};

TEST_F(StoreDiskParts, CommitTellsItsPartsInOrder) {
  EXPECT_TRUE(disk->commit("test", Sync::as_configured, [&] { part.write(1); }));
  EXPECT_EQ(part.told, "begin end committed ");
  EXPECT_EQ(count(), 1);
}

TEST_F(StoreDiskParts, WorkThatFailsLeavesNothingAndTheStateIsMemory) {
  const bool done = disk->commit("test", Sync::full, [&] {
    part.write(1);
    disk->database().exec("no SQL");
  });
  EXPECT_FALSE(done);
  EXPECT_EQ(part.told, "begin ");
  EXPECT_EQ(count(), 0);
  EXPECT_FALSE(disk->is_writable());
  EXPECT_FALSE(disk->commit("test", Sync::full, [&] { part.write(1); }));
  disk->try_to_write();
  EXPECT_TRUE(disk->is_writable());
  EXPECT_TRUE(disk->commit("test", Sync::full, [&] { part.write(1); }));
}

TEST_F(StoreDiskParts, MuchThatWaitsIsWrittenInPieces) {
  for (int i = 0; i < 1200; ++i) part.waiting.push_back(i);
  EXPECT_TRUE(disk->flush());
  EXPECT_TRUE(part.waiting.empty());
  EXPECT_EQ(count(), 1200);
  EXPECT_EQ(part.told, "begin end committed begin end committed begin end committed ");
  EXPECT_TRUE(disk->flush()) << "nothing waits";
  EXPECT_EQ(std::count(part.told.begin(), part.told.end(), 'b'), 3);
}

TEST_F(StoreDiskParts, WhatTheDiskRefusedWaitsOn) {
  part.waiting = {1, 2};
  const bool done = disk->commit("test", Sync::as_configured, [&] {
    disk->write_pending();
    disk->database().exec("no SQL");
  });
  EXPECT_FALSE(done);
  EXPECT_EQ(part.waiting.size(), 2U);
  disk->try_to_write();
  EXPECT_TRUE(disk->flush());
  EXPECT_EQ(count(), 2);
}

TEST_F(StoreDiskParts, DamagedFileIsSetAsideOnceAndItsPlaceIsTaken) {
  part.waiting = {7};
  EXPECT_TRUE(disk->commit("test", Sync::as_configured, [&] { part.write(7); }));
  part.told.clear();
  EXPECT_TRUE(disk->flush()) << "the row is there already, and the fresh file takes it";
  EXPECT_EQ(part.told, "begin lost load replaced begin end committed ");
  EXPECT_EQ(part.aside, "fxagent.db.corrupt-" + std::to_string(kNow));
  EXPECT_EQ(disk->set_aside(), part.aside);
  EXPECT_EQ(count(), 1);
  // The next such row counts as the program's own error.
  EXPECT_FALSE(disk->commit("test", Sync::as_configured, [&] { part.write(7); }));
  EXPECT_TRUE(disk->is_open());
  EXPECT_FALSE(disk->is_writable());
}

TEST_F(StoreDiskParts, SingleRowThatCannotBeReadLeavesTheFileWritable) {
  EXPECT_FALSE(disk->read([&] { disk->database().exec("no SQL"); }));
  EXPECT_TRUE(disk->is_writable());
  EXPECT_FALSE(disk->attempt("read", [&] { disk->database().exec("no SQL"); }));
  EXPECT_FALSE(disk->is_writable());
}

TEST_F(StoreDiskParts, CloseKeepsWhatIsThereAndTheLock) {
  disk->close();
  EXPECT_EQ(part.told, "kept ");
  EXPECT_FALSE(disk->is_open());
  StoreDisk next(config, kNow);
  next.open();
  EXPECT_TRUE(next.is_in_use());
  disk.reset();
  next.open();
  EXPECT_TRUE(next.is_writable());
}

}  // namespace
}  // namespace fxagent
