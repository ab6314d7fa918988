#include "agent/store/journal/started_commands.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstring>
#include <filesystem>
#include <fstream>

#include "tests/agent/store/shelf.h"

namespace fxagent::test {
namespace {

namespace fs = std::filesystem;

// The layout of the file, from agent/store/README.md.
constexpr std::size_t kBootAt = 8;
constexpr std::size_t kHeadWrittenAt = 80;
constexpr std::size_t kRecords = 128;
constexpr std::size_t kRecord = 32;
constexpr std::size_t kRecordWrittenAt = 24;

/// A store whose agent is killed: its files are opened again without a clean end.
struct StartedCommandsTest : ::testing::Test {
  /// Journals a command and returns its number.
  std::uint64_t journal(const std::string& id) {
    JournalEntry made = shelf.arrived(id);
    made.audit = told(id);  // a record stores the number in the file with it
    EXPECT_TRUE(shelf.journal(made));
    return made.number;
  }
  void start(std::uint64_t number) { shelf.store->started().mark(number); }
  /// Journals two commands and starts the first.
  void journal_two_and_start_one() {
    start(journal("started"));
    journal("waiting");
  }
  void kill() { shelf.store.reset(); }
  void start_one_of_two_and_kill() {
    journal_two_and_start_one();
    kill();
  }
  /// After a restart: the ids without a result, and true for each that was certainly not sent.
  std::map<std::string, bool> left() {
    std::map<std::string, bool> all;
    for (const JournalEntry& each : shelf.open().journal().unacknowledged())
      all[each.id] = each.surely_not_sent;
    return all;
  }
  std::string path() const { return shelf.config.path + "/fxagent.db.started"; }
  void overwrite(const std::string& bytes) const {
    std::fstream(path(), std::ios::binary | std::ios::in | std::ios::out) << bytes;
  }
  /// Sets the times in the marks, but not that of the file.
  void move_marks(std::int64_t by_ns) const {
    std::string bytes = content_of(path());
    for (const std::size_t at : {kHeadWrittenAt, kRecords + kRecordWrittenAt}) {
      std::int64_t written = 0;
      std::memcpy(&written, bytes.data() + at, sizeof written);
      ASSERT_GT(written, 0);
      written += by_ns;
      std::memcpy(bytes.data() + at, &written, sizeof written);
    }
    overwrite(bytes);
  }

  OpenShelf shelf;
  using Left = std::map<std::string, bool>;
  const Left kProven{{"started", false}, {"waiting", true}};
  const Left kNothing{{"started", false}, {"waiting", false}};
};

struct StartedCommandsKilled : StartedCommandsTest {
  StartedCommandsKilled() { start_one_of_two_and_kill(); }
};

TEST_F(StartedCommandsKilled, CommandThatWaitedSurelyWasNotSent) { EXPECT_EQ(left(), kProven); }

TEST_F(StartedCommandsTest, RunThatIsKilledBeforeItsRecoveryLosesNothing) {
  journal_two_and_start_one();
  for (int i = 0; i < 3; ++i) {
    kill();
    EXPECT_EQ(left(), kProven);
  }
}

TEST_F(StartedCommandsKilled, MarksOfSeveralRunsAreOne) {
  left();
  start(journal("started later"));
  journal("waiting later");
  kill();
  EXPECT_EQ(left(), (Left{{"started", false},
                          {"waiting", true},
                          {"started later", false},
                          {"waiting later", true}}));
}

TEST_F(StartedCommandsTest, CommandsOfTheRunThatAsksMayHaveLeft) {
  journal("mine");
  for (const JournalEntry& each : shelf.store->journal().unacknowledged())
    EXPECT_FALSE(each.surely_not_sent);
}

TEST_F(StartedCommandsKilled, CommandsOfTheRunThatAsksMayHaveLeftWhateverEarlierRunsProve) {
  EXPECT_EQ(left(), kProven);
  journal("mine");
  Left all;
  for (const JournalEntry& each : shelf.store->journal().unacknowledged())
    all[each.id] = each.surely_not_sent;
  EXPECT_EQ(all, (Left{{"started", false}, {"waiting", true}, {"mine", false}}));
}

TEST_F(StartedCommandsKilled, NothingIsProvenAfterAStartOfTheMachine) {
  std::string bytes = content_of(path());
  bytes[kBootAt] = bytes[kBootAt] == '0' ? '1' : '0';
  overwrite(bytes);
  EXPECT_EQ(left(), kNothing);
}

TEST_F(StartedCommandsTest, NothingIsProvenWithoutTheFileOrByAnother) {
  for (const std::string& there : {std::string(), std::string("x"), std::string(65664, '\0')}) {
    start_one_of_two_and_kill();
    fs::remove(path());
    if (!there.empty()) std::ofstream(path(), std::ios::binary) << there;
    EXPECT_EQ(left(), kNothing) << there.size();
    shelf.store->close();
    fs::remove_all(shelf.config.path);
    shelf.open();
  }
}

TEST_F(StartedCommandsKilled, NothingIsProvenOfACopyOfTheStore) {
  const std::string copy = shelf.scratch.path("copy");
  fs::copy(shelf.config.path, copy, fs::copy_options::recursive);
  shelf.config.path = copy;
  EXPECT_EQ(left(), kNothing);
}

TEST_F(StartedCommandsKilled, NothingIsProvenWhereTheDatabaseIsAnother) {
  fs::copy(shelf.file(), shelf.scratch.path("other"));
  fs::rename(shelf.scratch.path("other"), shelf.file());
  EXPECT_EQ(left(), kNothing);
}

// As if a backup of the whole directory had been restored: its marks are older than the file.
TEST_F(StartedCommandsKilled, NothingIsProvenByAnOldCopyInThePlaceOfTheFile) {
  move_marks(-10'000'000'000);
  EXPECT_EQ(left(), kNothing);
}

TEST_F(StartedCommandsKilled, NothingIsProvenByMarksThatAreYoungerThanTheFile) {
  move_marks(10'000'000'000);
  EXPECT_EQ(left(), kNothing);
}

TEST_F(StartedCommandsTest, NothingIsProvenWhereTheFileWasDeletedWhileTheAgentRan) {
  journal_two_and_start_one();
  fs::remove(path());
  start(journal("unseen"));
  kill();
  EXPECT_EQ(left(), (Left{{"started", false}, {"waiting", false}, {"unseen", false}}));
}

TEST_F(StartedCommandsTest, MarkThatCannotBeWrittenLeavesNothingProven) {
  journal("waiting");
  const std::uint64_t started = journal("started");
  {
    const DiskLimit full(kRecords);
    start(started);
  }
  kill();
  EXPECT_EQ(left(), kNothing);
}

TEST_F(StartedCommandsTest, MarkFindsItsPlaceOnADiskThatIsFull) {
  journal("waiting");
  const std::uint64_t started = journal("started");
  const auto size = fs::file_size(path());
  {
    const DiskLimit full(size);  // no file can grow
    start(started);
  }
  kill();
  EXPECT_EQ(fs::file_size(path()), size);
  EXPECT_EQ(left(), kProven);
}

TEST_F(StartedCommandsTest, FileThatCannotBeMadeHoldsNothingUpAndProvesNothing) {
  shelf.store->close();
  kill();
  fs::create_directories(path() + "/full");
  shelf.open();
  EXPECT_EQ(shelf.store->state(), "disk");
  start_one_of_two_and_kill();
  fs::remove_all(path());
  EXPECT_EQ(left(), kNothing);
}

TEST_F(StartedCommandsTest, LinkInThePlaceOfTheFileIsNotFollowed) {
  shelf.store->close();
  kill();
  const std::string victim = shelf.scratch.path("victim");
  std::ofstream(victim) << "mine";
  fs::create_symlink(victim, path());
  shelf.open();
  start_one_of_two_and_kill();
  EXPECT_EQ(left(), kProven);
  EXPECT_EQ(fs::file_size(victim), 4U);
}

TEST_F(StartedCommandsTest, FileIsForItsOwnerAloneAndGoesWithACleanEnd) {
  struct stat found {};
  ASSERT_EQ(::stat(path().c_str(), &found), 0);
  EXPECT_EQ(found.st_mode & 0777U, 0600U);
  shelf.store->close();
  EXPECT_FALSE(fs::exists(path()));
}

TEST_F(StartedCommandsTest, OfCommandsFromBeforeTheOldestMarkNothingIsProven) {
  journal("early");
  for (std::size_t i = 0; i < StartedCommands::kKept + 1; ++i)
    start(shelf.store->audit().next_command_number());
  journal("late");
  kill();
  EXPECT_EQ(left(), (Left{{"early", false}, {"late", true}}));
  EXPECT_EQ(fs::file_size(path()), kRecords + StartedCommands::kKept * kRecord);
}

TEST_F(StartedCommandsTest, OldestMarkIsKnownUntilThereIsNoRoomForIt) {
  start(journal("started"));
  journal("waiting");
  for (std::size_t i = 0; i < StartedCommands::kKept - 1; ++i)
    start(shelf.store->audit().next_command_number());
  kill();
  EXPECT_EQ(left(), kProven);
}

/// The store opens when this run has already sent commands.
TEST_F(StartedCommandsKilled, StoreThatOpensLateKnowsWhatWaitedAndNothingOfThisRun) {
  const std::string aside = shelf.scratch.path("aside");
  fs::rename(shelf.config.path, aside);
  shelf.block();
  shelf.open(kNow + 1000);
  const JournalEntry unmarked = shelf.arrived("of this run");
  EXPECT_FALSE(shelf.journal(unmarked));
  start(unmarked.number);
  fs::remove(shelf.config.path);
  fs::rename(aside, shelf.config.path);
  shelf.store->upkeep(kStart, kNow + 1000);
  shelf.store->upkeep(kStart + Store::kTryAgain, kNow + 1000);
  const auto found = shelf.store->take_found_late();
  ASSERT_TRUE(found);
  Left known;
  for (const JournalEntry& each : found->unacknowledged) known[each.id] = each.surely_not_sent;
  EXPECT_EQ(known, kProven);
  journal("waiting now");
  kill();
  EXPECT_EQ(
      left(),
      (Left{
          {"started", false}, {"waiting", false}, {"of this run", false}, {"waiting now", true}}));
}

TEST_F(StartedCommandsTest, DatabaseThatWasReplacedWhileTheAgentRanProvesNothing) {
  journal("waiting");
  start(journal("started"));
  for (const char* suffix : {"", "-wal", "-shm"}) fs::remove(shelf.file() + suffix);
  shelf.store->upkeep(kStart, kNow);
  journal("waiting now");
  kill();
  const Left now = left();
  EXPECT_EQ(now.count("waiting"), 0U) << "it was in the file that is gone";
  EXPECT_EQ(now.at("waiting now"), true) << "the file of marks is that of the new one";
}

}  // namespace
}  // namespace fxagent::test
