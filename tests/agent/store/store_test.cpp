#include "agent/store/store.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "tests/agent/store/power_cut.h"
#include "tests/agent/store/shelf.h"
#include "tests/support/other_program.h"
#include "tests/support/says.h"

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
  // The database, its WAL and the WAL's index; the lock; the marks; the refused commands.
  EXPECT_EQ(files, 6U);
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

TEST(Store, FileOfANewerOrMuchOlderProgramIsSetAsideAsItIs) {
  for (const auto& [version, who] : {std::pair(99, "a newer version of the agent"),
                                     std::pair(4, "an agent from before 0.1.0")}) {
    OpenShelf shelf;
    ASSERT_TRUE(shelf.add(rows(1, 3)));
    shelf.store->close();
    {
      SQLite::Database database = sqlite::open(shelf.file());
      ASSERT_NO_THROW(database.exec("PRAGMA user_version = " + std::to_string(version)));
    }
    testing::internal::CaptureStderr();
    EXPECT_EQ(shelf.open().state(), "disk");
    const std::string log = testing::internal::GetCapturedStderr();
    const std::string aside = shelf.file() + ".corrupt-" + std::to_string(kNow);
    EXPECT_NE(log.find(who), log.npos) << log;
    EXPECT_NE(log.find(aside), log.npos) << log;
    SQLite::Database kept = sqlite::open(aside);
    EXPECT_EQ(kept.execAndGet("SELECT count(*) FROM samples").getInt(), 3);
  }
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

TEST(Store, DiskThatRefusesIsLoggedOnceWithWhatItMeansAndTheCure) {
  testing::internal::CaptureStderr();
  ShelfWithoutDisk shelf;
  shelf.store->upkeep(kStart, kNow);
  shelf.store->upkeep(kStart + 10s, kNow);
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_EQ(std::ranges::count(log, '\n'), 1) << log;
  test::expect_says(log,
                    "commands are carried out, but samples and audit records are in memory "
                    "only: free or repair the disk, and do not restart before");
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
  EXPECT_TRUE(shelf.store->journal().unacknowledged_in_file().empty()) << "until it is read again";
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
  EXPECT_THROW(Store(shelf.config, kNow), std::runtime_error);
  EXPECT_THROW(await_other_agent(shelf.config, 0ms), std::runtime_error);
  EXPECT_EQ(shelf.store->state(), "disk");
}

TEST(Store, SecondAgentDoesNotStartUntilTheFirstHasWrittenItsOtherFiles) {
  OpenShelf shelf;
  shelf.store->close();
  EXPECT_THROW(await_other_agent(shelf.config, 0ms), std::runtime_error);
  shelf.store.reset();
  EXPECT_FALSE(await_other_agent(shelf.config, 0ms));
}

TEST(Store, SecondAgentOfRootDoesNotStartWhileTheServiceHasTheStore) {
  constexpr uid_t kOtherUser = 65534;
  OpenShelf shelf;
  for (const char* name : {"", "/fxagent.lock"})
    if (::chown((shelf.config.path + name).c_str(), kOtherUser, static_cast<gid_t>(-1)) != 0)
      GTEST_SKIP() << "only root can give a file to another user";
  EXPECT_THROW(await_other_agent(shelf.config, 0ms), std::runtime_error);
  EXPECT_THROW(Store(shelf.config, kNow), std::runtime_error);
  shelf.store.reset();
  EXPECT_FALSE(await_other_agent(shelf.config, 0ms));
  EXPECT_EQ(Store(shelf.config, kNow).state(), "memory");
}

TEST(Store, SecondAgentNamesTheProcessThatHasTheStore) {
  OpenShelf shelf;
  shelf.store.reset();
  const test::OtherProgram first(shelf.config.path + "/fxagent.lock",
                                 test::OtherProgram::Holds::locked);
  try {
    const Store second(shelf.config, kNow);
    FAIL() << "its state is " << second.state();
  } catch (const std::runtime_error& refusal) {
    const std::string text = refusal.what();
    test::expect_says(text, "cannot start: " + shelf.config.path + " is in use by ");
    test::expect_says(text, ", pid " + std::to_string(first.pid()) + "): stop it, or ");
  }
}

}  // namespace
}  // namespace fxagent
