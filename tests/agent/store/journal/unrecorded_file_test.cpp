#include "agent/store/journal/unrecorded_file.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/agent/store/power_cut.h"
#include "tests/agent/store/shelf.h"
#include "tests/agent/store/synced_files.h"

namespace fxagent::test {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kSize = UnrecordedFile::kPlaces * UnrecordedFile::kPlaceBytes;

struct UnrecordedFileTest : ::testing::Test {
  /// Returns what the next start finds.
  std::vector<JournalEntry> left() const { return UnrecordedFile(directory()).open(); }
  std::vector<std::string> left_ids() const {
    std::vector<std::string> ids;
    for (const JournalEntry& each : left()) ids.push_back(each.id);
    return ids;
  }
  std::string directory() const { return scratch.directory(); }
  std::string path() const { return scratch.path("fxagent.db.unrecorded"); }

  Scratch scratch;
  UnrecordedFile file{directory()};
  using Ids = std::vector<std::string>;
};

struct UnrecordedFileOpen : UnrecordedFileTest {
  UnrecordedFileOpen() { EXPECT_TRUE(file.open().empty()); }
};

TEST_F(UnrecordedFileOpen, EntryComesBackWhole) {
  JournalEntry made = entry("x", "{1}");
  made.number = 7;
  made.payload = "{\"id\":\"x\"}";
  made.place = "0123456789abcdef";
  made.acknowledged = true;
  file.keep(made);
  const auto found = left();
  ASSERT_EQ(found.size(), 1U);
  const JournalEntry& one = found[0];
  EXPECT_EQ(one.device, "a");
  EXPECT_EQ(one.id, "x");
  EXPECT_EQ(one.number, 7U);
  EXPECT_EQ(one.received_ms, kNow);
  EXPECT_EQ(one.deadline_ms, kNow + 10000);
  EXPECT_EQ(one.op, "write");
  EXPECT_EQ(one.result, "{1}");
  EXPECT_EQ(one.payload, made.payload);
  EXPECT_EQ(one.place, made.place);
  EXPECT_EQ(one.response_topic, "hmi/replies");
  EXPECT_EQ(one.correlation, (Bytes{1, 0, 255}));
  EXPECT_TRUE(one.acknowledged);
}

TEST_F(UnrecordedFileOpen, LargeEntryKeepsItsId) {
  JournalEntry made = entry("x", std::string(1000, '1'));
  file.keep(made);
  EXPECT_EQ(left().at(0).result, "");
  EXPECT_EQ(left().at(0).response_topic, "hmi/replies");
  made.response_topic.assign(1000, 't');
  file.keep(made);
  EXPECT_EQ(left().at(0).id, "x");
  EXPECT_EQ(left().at(0).response_topic, "");
}

TEST_F(UnrecordedFileOpen, LargeEntryKeepsItsIdANumber) {
  const std::string rest = ",\"detail\":\"" + std::string(1000, 'x') + "\"}";
  JournalEntry made = entry("4711");
  made.payload = "{\"id\":4711" + rest;
  file.keep(made);
  EXPECT_EQ(left().at(0).payload, "{\"id\":4711}");
  made.result = std::exchange(made.payload, {});
  file.keep(made);
  EXPECT_EQ(left().at(0).payload, "{\"id\":4711}");
  made.result = "{\"id\":\"4711\"" + rest;
  file.keep(made);
  EXPECT_EQ(left().at(0).payload, "");
}

TEST_F(UnrecordedFileOpen, CommandHasOnePlaceAndTheNextStartGoesOn) {
  file.keep(entry("x"));
  file.keep(entry("y"));
  file.keep(entry("x", "{1}"));
  UnrecordedFile next(directory());
  EXPECT_EQ(next.open().at(0).result, "{1}");
  next.keep(entry("y", "{2}"));
  next.keep(entry("z"));
  EXPECT_EQ(left_ids(), (Ids{"x", "y", "z"}));
  EXPECT_EQ(left().at(1).result, "{2}");
}

TEST_F(UnrecordedFileOpen, OldestMakesRoomAlsoAfterAStart) {
  const auto keep = [](UnrecordedFile& to, std::uint64_t number) {
    JournalEntry made = entry(std::to_string(number));
    made.number = number;
    to.keep(made);
  };
  for (std::uint64_t number = 1; number <= UnrecordedFile::kPlaces + 1; ++number)
    keep(file, number);
  UnrecordedFile next(directory());
  EXPECT_EQ(next.open().size(), UnrecordedFile::kPlaces);
  keep(next, UnrecordedFile::kPlaces + 2);
  const Ids ids = left_ids();
  EXPECT_EQ(ids.size(), UnrecordedFile::kPlaces);
  EXPECT_EQ(ids.at(0), std::to_string(UnrecordedFile::kPlaces + 1));
  EXPECT_EQ(ids.at(1), std::to_string(UnrecordedFile::kPlaces + 2));
  EXPECT_EQ(ids.at(2), "3");
}

TEST_F(UnrecordedFileOpen, FullDiskTakesEntries) {
  EXPECT_EQ(fs::file_size(path()), kSize);
  const DiskLimit full(kSize);  // no file can grow
  file.keep(entry("x"));
  EXPECT_EQ(left_ids(), Ids{"x"});
}

TEST_F(UnrecordedFileOpen, NothingIsLeftAfterClear) {
  file.keep(entry("x"));
  file.keep(entry("y"));
  file.clear();
  EXPECT_EQ(left_ids(), Ids{});
  file.keep(entry("z"));
  EXPECT_EQ(left_ids(), Ids{"z"});
}

TEST_F(UnrecordedFileOpen, DamagedPlaceIsEmpty) {
  for (const char* id : {"x", "y", "z"}) file.keep(entry(id));
  const std::string whole = content_of(path());
  for (const std::size_t at : {0U, 8U, 24U, 30U, 32U, 40U}) {
    std::string bytes = whole;
    char& byte = bytes[UnrecordedFile::kPlaceBytes + at];
    byte = static_cast<char>(byte ^ 0x55);
    std::ofstream(path(), std::ios::binary) << bytes;
    EXPECT_EQ(left_ids(), (Ids{"x", "z"})) << at;
  }
}

TEST_F(UnrecordedFileTest, EntriesSurviveAPowerCut) {
  const SyncedFiles plain;
  file.open();
  file.keep(entry("x"));
  file.synchronise();
  const std::string after = scratch.path("after");
  plain.leave(directory(), after, "fxagent.db.unrecorded");
  EXPECT_EQ(UnrecordedFile(after).open().size(), 1U);
}

TEST_F(UnrecordedFileTest, FileWithoutRoomIsMadeLater) {
  {
    const DiskLimit full(1000);
    testing::internal::CaptureStderr();
    file.open();
    file.keep(entry("x"));
    file.clear();
    EXPECT_NE(testing::internal::GetCapturedStderr().find("unrecorded_commands"),
              std::string::npos);
    EXPECT_EQ(fs::file_size(path()), 0U);
  }
  file.open();
  file.keep(entry("y"));
  EXPECT_EQ(left_ids(), Ids{"y"});
}

TEST_F(UnrecordedFileTest, LinkInThePlaceOfTheFileIsNotFollowed) {
  const std::string victim = scratch.write("victim", "untouched");
  fs::create_symlink(victim, path());
  file.open();
  file.keep(entry("x"));
  EXPECT_EQ(content_of(victim), "untouched");
}

TEST_F(UnrecordedFileOpen, FileThatWasReplacedIsOpenedAnew) {
  file.keep(entry("old"));
  EXPECT_TRUE(file.open().empty()) << "it is open";
  fs::remove(path());
  EXPECT_TRUE(file.open().empty());
  file.keep(entry("new"));
  EXPECT_EQ(left_ids(), Ids{"new"});
}

/// A store whose database cannot grow, while the file beside it has its room.
struct UnrecordedStoreTest : ::testing::Test {
  UnrecordedStoreTest() {
    journaled = shelf.arrived("journaled");
    journaled.payload = "{\"id\":\"journaled\"}";
    EXPECT_TRUE(shelf.journal(journaled));
    // SQLite's log is larger than the file now, and too small for a checkpoint.
    JournalEntry large = shelf.arrived("large");
    large.payload.assign(kSize + kSize / 32, ' ');
    EXPECT_TRUE(shelf.journal(large));
    shelf.store->upkeep(kStart, kNow);
    full.emplace(kSize);
  }
  /// Takes a command that the database refuses.
  JournalEntry refused(const std::string& id) {
    JournalEntry made = shelf.arrived(id);
    made.audit = told(id);
    EXPECT_FALSE(shelf.journal(made));
    return made;
  }
  void answer(JournalEntry command) {
    command.result = "{1}";
    command.audit = told(command.id);
    command.payload.clear();
    shelf.record(command);
  }
  /// Records the result of an admitted command that was not sent in time.
  void expire(JournalEntry command) {
    command.result = "{expired}";
    command.refused = true;
    command.payload.clear();
    shelf.record(command);
  }
  void acknowledge(const JournalEntry& command) {
    shelf.store->journal().acknowledge("a", command.id, command.number);
    shelf.store->upkeep(kStart + std::chrono::seconds(1), kNow);  // as in the uplink's next round
  }
  /// Kills the agent and starts it again, with room on the disk.
  StoredJournal& start_again() {
    shelf.store.reset();
    full.reset();
    return shelf.open(kNow + 1000).journal();
  }
  /// Keeps the database from opening while it lives.
  std::optional<SQLite::Database> in_use() {
    std::optional<SQLite::Database> other(sqlite::open(shelf.file()));
    other->exec("PRAGMA locking_mode = EXCLUSIVE");
    other->exec("BEGIN EXCLUSIVE");
    return other;
  }
  /// After unmount(): the directory is back, and the open store tries it.
  void mount_late(std::int64_t utc_ms) {
    fs::remove_all(shelf.config.path);
    fs::rename(shelf.config.path + "-away", shelf.config.path);
    shelf.store->upkeep(kStart, utc_ms);
    shelf.store->upkeep(kStart + Store::kTryAgain, utc_ms);
  }
  void write() { shelf.store->upkeep(kStart, kNow + 1000); }
  /// Kills the agent and starts it again on a disk that lets it only read the database, while
  /// UnrecordedFile is as it was at `path`.
  void start_to_read_only(const std::string& path) {
    full.reset();
    shelf.store.reset();
    fs::copy_file(path, shelf.file() + ".unrecorded", fs::copy_options::overwrite_existing);
    full.emplace(4096);
    shelf.open(kNow + 1000);
    EXPECT_EQ(shelf.store->state(), "memory");
  }
  /// Gives the disk its room back. Returns the ids that the store has found late, unacknowledged.
  std::set<std::string> found_late() {
    full.reset();
    shelf.store->upkeep(kStart, kNow + 1000);
    shelf.store->upkeep(kStart + Store::kTryAgain, kNow + 11000);
    EXPECT_EQ(shelf.store->state(), "disk");
    std::set<std::string> ids;
    if (const auto late = shelf.store->take_found_late())
      for (const JournalEntry& each : late->unacknowledged) ids.insert(each.id);
    return ids;
  }
  std::set<std::string> known() {
    std::set<std::string> ids;
    for (const KnownId& each : shelf.store->journal().known_ids()) ids.insert(each.id);
    return ids;
  }
  std::set<std::string> unacknowledged() {
    std::set<std::string> ids;
    for (const JournalEntry& each : shelf.store->journal().unacknowledged()) ids.insert(each.id);
    return ids;
  }

  using Ids = std::set<std::string>;
  OpenShelf shelf;
  JournalEntry journaled;
  std::optional<DiskLimit> full;
};

TEST_F(UnrecordedStoreTest, CommandThatTheDiskRefusedIsKnownAfterACrash) {
  const JournalEntry command = refused("x");
  EXPECT_EQ(shelf.store->state(), "memory");
  answer(command);
  acknowledge(command);
  StoredJournal& journal = start_again();
  const auto unwritten = journal.unwritten();
  ASSERT_EQ(unwritten.size(), 1U);
  EXPECT_EQ(unwritten[0].id, "x");
  EXPECT_EQ(unwritten[0].result, "{1}");
  EXPECT_TRUE(unwritten[0].acknowledged);
  EXPECT_EQ(shelf.found("x")->result, "{1}");
  EXPECT_GT(journal.next_command_number(), command.number);
  write();
  EXPECT_TRUE(journal.unwritten().empty());
  EXPECT_EQ(known(), Ids{"x"});
  EXPECT_TRUE(shelf.open().journal().unwritten().empty()) << "the file is empty";
  EXPECT_EQ(known(), Ids{"x"});
  EXPECT_EQ(unacknowledged(), (Ids{"journaled", "large"}));
}

TEST_F(UnrecordedStoreTest, CommandWithoutAResultIsFoundAndItIsKnownIfItWasSent) {
  refused("waited");
  shelf.store->started().mark(refused("sent").number);
  const auto unwritten = start_again().unwritten();
  ASSERT_EQ(unwritten.size(), 2U);
  EXPECT_EQ(unwritten[0].id, "waited");
  EXPECT_TRUE(unwritten[0].surely_not_sent);
  EXPECT_FALSE(unwritten[1].surely_not_sent);
  write();
  EXPECT_EQ(unacknowledged(), (Ids{"journaled", "large", "waited", "sent"}));
}

TEST_F(UnrecordedStoreTest, ResultThatWasPublishedIsTheOnlyOneOfItsCommand) {
  answer(journaled);
  EXPECT_EQ(shelf.store->state(), "memory");
  acknowledge(journaled);
  const auto unwritten = start_again().unwritten();
  ASSERT_EQ(unwritten.size(), 1U);
  EXPECT_EQ(unwritten[0].result, "{1}");
  EXPECT_TRUE(unwritten[0].acknowledged);
  write();
  EXPECT_EQ(unacknowledged(), Ids{"large"});
  EXPECT_EQ(known(), Ids{"journaled"});
}

TEST_F(UnrecordedStoreTest, CleanStopKeepsWhatTheDiskRefusesThen) {
  const JournalEntry command = refused("x");
  answer(command);
  shelf.store->journal().acknowledge("a", "x", command.number);
  shelf.store->close();
  EXPECT_TRUE(fs::exists(shelf.file() + ".started"));
  EXPECT_TRUE(start_again().unwritten().at(0).acknowledged);
}

TEST_F(UnrecordedStoreTest, CleanStopIsTheFirstThatTheDiskRefuses) {
  shelf.store->journal().acknowledge("a", "journaled", journaled.number);
  shelf.store->close();
  EXPECT_TRUE(fs::exists(shelf.file() + ".started"));
  EXPECT_TRUE(start_again().unwritten().at(0).acknowledged);
}

TEST_F(UnrecordedStoreTest, SecondCrashLosesNothing) {
  refused("x");
  start_again();
  EXPECT_EQ(start_again().unwritten().size(), 1U);
}

TEST_F(UnrecordedStoreTest, RefusedCommandTakesNoPlace) {
  refused("x");
  JournalEntry rejected = shelf.arrived("rejected", "{}");
  rejected.refused = true;
  shelf.record(rejected);
  EXPECT_EQ(start_again().unwritten().size(), 1U);
}

TEST_F(UnrecordedStoreTest, AuditTellsThatRecordsAreLost) {
  answer(refused("x"));
  start_again();
  write();
  const auto records = audit_of(shelf);
  ASSERT_FALSE(records.empty());
  EXPECT_NE(records.back().find("\"lost\""), std::string::npos) << records.back();
  EXPECT_NE(records.back().find("\"records\":2"), std::string::npos) << records.back();
}

TEST_F(UnrecordedStoreTest, TimesFollowAClockThatIsSet) {
  refused("x");
  constexpr std::int64_t kSet = 86'400'000;
  shelf.store->upkeep(kStart, kNow);
  shelf.store->upkeep(kStart + std::chrono::seconds(1), kNow + 1000 + kSet);
  EXPECT_EQ(start_again().unwritten().at(0).received_ms, kNow + kSet);
}

TEST_F(UnrecordedStoreTest, CommandIsKnownWhileTheDatabaseDoesNotOpen) {
  refused("x");
  shelf.store.reset();
  std::optional<SQLite::Database> other(in_use());
  StoredJournal& journal = start_again();
  EXPECT_EQ(shelf.store->state(), "memory");
  EXPECT_EQ(journal.unwritten().at(0).id, "x");
  other.reset();
  EXPECT_EQ(found_late(), (Ids{"journaled", "large"})) << "x was known before";
  EXPECT_EQ(unacknowledged(), (Ids{"journaled", "large", "x"}));
}

TEST_F(UnrecordedStoreTest, OlderEntryIsNotTakenWhileTheDatabaseIsOnlyRead) {
  const JournalEntry command = refused("x");
  const std::string older = shelf.scratch.path("older");
  fs::copy_file(shelf.file() + ".unrecorded", older);
  full.reset();
  answer(command);
  acknowledge(command);
  shelf.store->upkeep(kStart + Store::kTryAgain + std::chrono::seconds(1), kNow);
  ASSERT_EQ(shelf.store->state(), "disk");
  start_to_read_only(older);
  EXPECT_TRUE(shelf.store->journal().unwritten().empty());
  EXPECT_TRUE(known().contains("x"));
  EXPECT_EQ(found_late(), (Ids{"journaled", "large"}));
}

TEST_F(UnrecordedStoreTest, AcknowledgedResultIsNotFoundLate) {
  full.reset();
  answer(journaled);
  shelf.store->upkeep(kStart, kNow);
  full.emplace(kSize);
  shelf.store->journal().acknowledge("a", "journaled", journaled.number);
  shelf.store->close();
  const std::string kept = shelf.scratch.path("kept");
  fs::copy_file(shelf.file() + ".unrecorded", kept);
  start_to_read_only(kept);
  EXPECT_TRUE(shelf.store->journal().unwritten().at(0).acknowledged);
  EXPECT_EQ(found_late(), Ids{"large"});
}

TEST_F(UnrecordedStoreTest, DeviceThatJoinsKnowsWhatTheDatabaseDoesNotHaveYet) {
  answer(journaled);
  acknowledge(journaled);
  refused("x");
  StoredJournal& journal = start_again();
  const auto known = journal.known_ids("a");
  ASSERT_EQ(known.size(), 1U);
  EXPECT_EQ(known[0].id, "journaled");
  EXPECT_TRUE(journal.known_ids("b").empty());
  const auto unacknowledged = journal.unacknowledged("a");
  ASSERT_EQ(unacknowledged.size(), 2U);
  EXPECT_EQ(unacknowledged[0].id, "large");
  EXPECT_EQ(unacknowledged[1].id, "x");
  EXPECT_TRUE(journal.unacknowledged("b").empty());
}

TEST_F(UnrecordedStoreTest, FileThatComesLateBringsItsCommands) {
  start_again();
  shelf.store->upkeep(kStart, kNow);
  const std::string other = shelf.scratch.path("other");
  fs::create_directory(other);
  UnrecordedFile late(other);
  late.open();
  JournalEntry over = entry("over", "{1}");
  over.acknowledged = true;
  over.number = 1000;
  late.keep(over);
  late.keep(entry("left"));
  fs::rename(other + "/fxagent.db.unrecorded", shelf.file() + ".unrecorded");
  shelf.store->upkeep(kStart + std::chrono::minutes(1), kNow + 60000);
  const auto found = shelf.store->take_found_late();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->ids.size(), 2U);
  ASSERT_EQ(found->unacknowledged.size(), 1U);
  EXPECT_EQ(found->unacknowledged[0].id, "left");
}

TEST_F(UnrecordedStoreTest, DirectoryThatComesLateBringsItsCommands) {
  refused("x");
  full.reset();
  shelf.unmount();
  shelf.open(kNow + 1000);
  mount_late(kNow + 1000);
  EXPECT_EQ(found_late(), (Ids{"journaled", "large", "x"}));
}

TEST_F(UnrecordedStoreTest, CommandThatExpiredKeepsItsResult) {
  const JournalEntry command = refused("x");
  expire(command);
  acknowledge(command);
  const auto unwritten = start_again().unwritten();
  ASSERT_EQ(unwritten.size(), 1U);
  EXPECT_EQ(unwritten[0].result, "{expired}");
  EXPECT_TRUE(unwritten[0].acknowledged);
}

TEST_F(UnrecordedStoreTest, CommandInTheDatabaseThatExpiredKeepsItsResult) {
  expire(journaled);
  acknowledge(journaled);
  start_again();
  write();
  EXPECT_EQ(unacknowledged(), Ids{"large"});
}

TEST_F(UnrecordedStoreTest, CommandCountsAsSentIfARunWithoutTheDatabaseSentIt) {
  shelf.store.reset();
  full.reset();
  std::optional<SQLite::Database> other(in_use());
  shelf.open(kNow + 1000);
  EXPECT_EQ(shelf.store->state(), "memory");
  shelf.store->started().mark(refused("x").number);
  shelf.store.reset();
  other.reset();
  const auto unwritten = shelf.open(kNow + 2000).journal().unwritten();
  ASSERT_EQ(unwritten.size(), 1U);
  EXPECT_FALSE(unwritten[0].surely_not_sent);
}

TEST_F(UnrecordedStoreTest, CommandThatWasSentCountsSoAfterARunThatOpenedLate) {
  shelf.store->audit().count_above(
      kNow);  // numbers from the clock, as after a start without a file
  shelf.store->started().mark(refused("x").number);
  full.reset();
  shelf.unmount();
  shelf.open(1000);  // the clock starts in 1970
  mount_late(1000);
  ASSERT_EQ(shelf.store->state(), "disk");
  shelf.open(kNow);
  for (const JournalEntry& each : shelf.store->journal().unacknowledged())
    EXPECT_FALSE(each.id == "x" && each.surely_not_sent);
}

TEST_F(UnrecordedStoreTest, TimesOfAnEarlierStartOfTheMachineStay) {
  refused("x");
  start_again();
  full.emplace(kSize);
  constexpr std::int64_t kAhead = 3 * 86'400'000LL;
  shelf.store->upkeep(kStart, kNow + kAhead);
  EXPECT_EQ(shelf.store->state(), "memory");
  shelf.store->upkeep(kStart + std::chrono::seconds(1), kNow + 1000);
  EXPECT_EQ(start_again().unwritten().at(0).received_ms, kNow);
}

TEST_F(UnrecordedStoreTest, TimesOfAnEarlierRunOfThisStartFollowTheClock) {
  refused("x");
  start_again();
  full.emplace(kSize);
  constexpr std::int64_t kSet = 86'400'000;
  shelf.store->upkeep(kStart, kNow + 1000);
  shelf.store->upkeep(kStart + std::chrono::seconds(1), kNow + 2000 + kSet);
  EXPECT_EQ(start_again().unwritten().at(0).received_ms, kNow + kSet);
}

TEST_F(UnrecordedStoreTest, PublishedTotalTimeIsKept) {
  for (JournalEntry each : {journaled, refused("x")}) {
    each.result = R"({"t":{"total_ms":null,"x":1}})";
    each.payload.clear();
    shelf.record(each);
    shelf.store->journal().acknowledge("a", each.id, each.number, "12.5");
  }
  shelf.store->upkeep(kStart + std::chrono::seconds(1), kNow);
  start_again();
  write();
  EXPECT_EQ(shelf.found("x")->result, R"({"t":{"total_ms":12.5,"x":1}})");
  EXPECT_EQ(shelf.found("journaled")->result, R"({"t":{"total_ms":12.5,"x":1}})");
}

TEST_F(UnrecordedStoreTest, PublishedTotalTimeOfAResultInTheDatabaseIsKept) {
  full.reset();
  journaled.result = R"({"t":{"total_ms":null}})";
  shelf.record(journaled);
  shelf.store->upkeep(kStart, kNow);
  full.emplace(kSize);
  shelf.store->journal().acknowledge("a", "journaled", journaled.number, "12.5");
  shelf.store->close();
  start_again();
  write();
  EXPECT_EQ(shelf.found("journaled")->result, R"({"t":{"total_ms":12.5}})");
}

TEST_F(UnrecordedStoreTest, DeletedFileIsMadeAnew) {
  start_again();
  const std::string path = shelf.file() + ".unrecorded";
  shelf.store->upkeep(kStart, kNow);
  fs::remove(path);
  shelf.store->upkeep(kStart + std::chrono::minutes(1), kNow + 60000);
  EXPECT_EQ(fs::file_size(path), kSize);
}

TEST_F(UnrecordedStoreTest, StoreWithoutCommandsNeedsNoFile) {
  shelf.store.reset();
  fs::remove(shelf.file() + ".unrecorded");
  shelf.config.keeps_commands = false;
  shelf.open(kNow);
  EXPECT_FALSE(fs::exists(shelf.file() + ".unrecorded"));
}

TEST(UnrecordedStorePower, CommandSurvivesAPowerCutAfterItsMoveToTheDatabase) {
  PowerCut power;
  const SyncedFiles plain;
  OpenShelf shelf;
  ASSERT_TRUE(shelf.journal(shelf.arrived("before")));
  shelf.store->upkeep(kStart, kNow);
  const auto refuse = [&](const std::string& id) {
    power.set_failing(true);
    EXPECT_FALSE(shelf.journal(shelf.arrived(id)));
    power.set_failing(false);
  };
  refuse("x");
  const SteadyTime later = kStart + std::chrono::seconds(1);
  shelf.store->upkeep(later, kNow + 1000);
  shelf.store->upkeep(later + Store::kTryAgain, kNow + 11000);
  ASSERT_EQ(shelf.store->state(), "disk");
  refuse("y");
  StoreConfig after = shelf.config;
  after.path = shelf.scratch.path("after");
  power.leave(shelf.config.path, after.path);
  plain.leave(shelf.config.path, after.path, "fxagent.db.unrecorded");
  Store next(after, kNow);
  EXPECT_TRUE(next.journal().find("a", "y"));
  EXPECT_TRUE(next.journal().find("a", "x"));
}

}  // namespace
}  // namespace fxagent::test
