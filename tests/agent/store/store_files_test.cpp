// The store's files in a directory that others can write: deleted, replaced, or created earlier as
// links.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "tests/agent/store/shelf.h"

namespace fxagent {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

using test::kNow;
using test::kStart;
using test::rows;

struct StoreFiles : ::testing::Test, test::Shelf {
  std::string in_store(const std::string& name) const { return config.path + "/" + name; }
  /// Opens a store with three rows; its next minute is due at kStart + 60 s.
  void open_with_rows() {
    open();
    store->upkeep(kStart, kNow);
    ASSERT_TRUE(add(rows(1, 3)));
  }
  void a_minute_later() const { store->upkeep(kStart + 60s, kNow + 60000); }
  void expect_noticed_and_usable() {
    EXPECT_EQ(store->samples().take_dropped()["a"], 3U);
    ASSERT_EQ(store->state(), "disk");
    EXPECT_EQ(store->samples().rows(), 0U);
    ASSERT_TRUE(add(rows(4, 5)));
    EXPECT_EQ(open().samples().rows(), 2U);
  }
};

TEST_F(StoreFiles, DirectoryThatWasDeletedIsNoticedWithinAMinuteAndMadeAnew) {
  open_with_rows();
  fs::remove_all(config.path);
  store->upkeep(kStart + 59s, kNow + 59000);
  EXPECT_EQ(store->samples().rows(), 3U);
  a_minute_later();
  expect_noticed_and_usable();
}

TEST_F(StoreFiles, FileThatWasDeletedIsNoticed) {
  open_with_rows();
  fs::remove(in_store("fxagent.db"));
  a_minute_later();
  expect_noticed_and_usable();
}

// The database file is unchanged. Data written to an unlinked log is in no file.
TEST_F(StoreFiles, LogThatWasDeletedIsNoticed) {
  open_with_rows();
  fs::remove(in_store("fxagent.db-wal"));
  a_minute_later();
  EXPECT_EQ(store->samples().take_dropped()["a"], 3U);
  ASSERT_EQ(store->state(), "disk");
  const std::uint64_t found = store->samples().rows();  // rows of a completed checkpoint
  ASSERT_TRUE(add(rows(4, 5)));
  EXPECT_EQ(open().samples().rows(), found + 2);
}

TEST_F(StoreFiles, LockThatWasDeletedIsTakenAnew) {
  open_with_rows();
  fs::remove(in_store("fxagent.lock"));
  a_minute_later();
  ASSERT_EQ(store->state(), "disk");
  EXPECT_THROW(Store(config, kNow), std::runtime_error);
}

TEST_F(StoreFiles, LockThatWasDeletedDoesNotInterruptCommands) {
  open_with_rows();
  ASSERT_TRUE(journal(arrived("pending")));
  record(arrived("unacknowledged", "{}"));
  fs::remove(in_store("fxagent.lock"));
  a_minute_later();
  ASSERT_EQ(store->state(), "disk");
  EXPECT_FALSE(store->take_found_late());
}

TEST_F(StoreFiles, CommandsOfAnAgentThatCameAndWentAfterTheLockWasDeletedAreFound) {
  open_with_rows();
  fs::remove(in_store("fxagent.lock"));
  {
    Store other(config, kNow);
    JournalEntry command = test::entry("of the other");
    command.number = other.audit().next_command_number();
    ASSERT_TRUE(other.journal().journal(std::vector{command}));
  }
  a_minute_later();
  ASSERT_EQ(store->state(), "disk");
  const auto late = store->take_found_late();
  ASSERT_TRUE(late);
  ASSERT_EQ(late->unacknowledged.size(), 1U);
  EXPECT_EQ(late->unacknowledged[0].id, "of the other");
}

TEST_F(StoreFiles, CommandsThatARunningAgentKeepsForAFullDiskAreLeftToIt) {
  open_with_rows();
  fs::rename(config.path, scratch.path("away"));
  Store other(config, kNow);
  other.upkeep(kStart, kNow);
  JournalEntry command = test::entry("of the other");
  command.number = other.audit().next_command_number();
  {
    const test::DiskLimit full(1000);
    ASSERT_FALSE(other.journal().journal(std::vector{command}));
  }
  a_minute_later();
  ASSERT_EQ(store->state(), "memory");
  EXPECT_FALSE(store->take_found_late());
}

TEST_F(StoreFiles, WhatIsFoundInAReplacedDirectoryIsTaken) {
  open();
  ASSERT_TRUE(add(rows(1, 7)));
  store.reset();
  const std::string other = scratch.path("other");
  fs::rename(config.path, other);
  open_with_rows();
  fs::rename(config.path, scratch.path("away"));
  fs::rename(other, config.path);
  a_minute_later();
  EXPECT_EQ(store->state(), "disk");
  EXPECT_EQ(store->samples().take_dropped()["a"], 3U);
  EXPECT_EQ(store->samples().rows(), 7U);
  EXPECT_EQ(store->samples().recovered(), 7U);
}

TEST_F(StoreFiles, NothingThatIsInItsPlaceIsTouched) {
  open_with_rows();
  a_minute_later();
  EXPECT_TRUE(store->samples().take_dropped().empty());
  EXPECT_EQ(store->samples().rows(), 3U);
}

TEST_F(StoreFiles, DirectoryThatOthersMayWriteIsRefused) {
  fs::create_directory(config.path);
  for (const mode_t mode : {0777U, 0770U, 0707U}) {
    ASSERT_EQ(::chmod(config.path.c_str(), mode), 0);
    EXPECT_EQ(open().state(), "memory") << std::oct << mode;
    EXPECT_FALSE(fs::exists(in_store("fxagent.db")));
  }
  EXPECT_NE(make_store_file(config.path).find("chmod 700"), std::string::npos);
  // In a sticky directory, other users cannot replace files.
  ASSERT_EQ(::chmod(config.path.c_str(), 01777), 0);
  EXPECT_EQ(open().state(), "disk");
}

TEST_F(StoreFiles, DirectoryOfSomebodyElseIsRefused) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root can give a directory away: run it as root";
  fs::create_directory(config.path);
  ASSERT_EQ(::chmod(config.path.c_str(), 0700), 0);
  ASSERT_EQ(::chown(config.path.c_str(), 65533, 65533), 0);
  EXPECT_EQ(open().state(), "memory");
  EXPECT_NE(make_store_file(config.path).find("belongs to user 65533"), std::string::npos);
}

TEST_F(StoreFiles, LinkIsNotFollowedAndItsVictimStaysAsItIs) {
  const std::string victim = scratch.path("victim");
  std::ofstream(victim) << "not a database";
  ASSERT_EQ(::chmod(victim.c_str(), 0644), 0);
  fs::create_directory(config.path);
  ASSERT_EQ(::chmod(config.path.c_str(), 0700), 0);
  fs::create_symlink(victim, in_store("fxagent.db"));
  EXPECT_EQ(open().state(), "memory");
  EXPECT_NE(make_store_file(config.path).find("symbolic link"), std::string::npos);
  struct stat found {};
  ASSERT_EQ(::stat(victim.c_str(), &found), 0);
  EXPECT_EQ(found.st_mode & 0777, 0644U);
  EXPECT_EQ(found.st_size, 14);
  // A hard link is the same attack in another form.
  fs::remove(in_store("fxagent.db"));
  fs::create_hard_link(victim, in_store("fxagent.db"));
  EXPECT_EQ(open().state(), "memory");
  ASSERT_EQ(::stat(victim.c_str(), &found), 0);
  EXPECT_EQ(found.st_mode & 0777, 0644U);
}

TEST_F(StoreFiles, LockThatIsALinkMakesNoFileElsewhere) {
  const std::string victim = scratch.path("victim");
  fs::create_directory(config.path);
  ASSERT_EQ(::chmod(config.path.c_str(), 0700), 0);
  fs::create_symlink(victim, in_store("fxagent.lock"));
  EXPECT_EQ(open().state(), "memory");
  EXPECT_FALSE(fs::exists(victim));
}

}  // namespace
}  // namespace fxagent
