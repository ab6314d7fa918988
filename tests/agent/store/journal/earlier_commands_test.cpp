// The ids of earlier runs when the database does not open.
#include "agent/store/journal/earlier_commands.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <set>

#include "tests/agent/store/shelf.h"

namespace fxagent::test {
namespace {

namespace fs = std::filesystem;
using Ids = std::set<std::string>;

Ids ids_of(const std::vector<KnownId>& known) {
  Ids ids;
  for (const KnownId& each : known) ids.insert(each.id);
  return ids;
}

class EarlierCommandsTest : public testing::Test {
 protected:
  EarlierCommandsTest() {
    shelf.record_acknowledged(shelf.arrived("over", R"({"status":"SUCCEEDED"})"));
    shelf.record(shelf.arrived("unacknowledged", "{}"));
    shelf.journal(shelf.arrived("interrupted"));
  }
  StoredJournal& open_on_a_full_disk() {
    shelf.store->close();
    full.emplace(4096);
    StoredJournal& journal = shelf.open().journal();
    EXPECT_EQ(shelf.store->state(), "memory");
    return journal;
  }

  OpenShelf shelf;
  std::optional<DiskLimit> full;
  const Ids all{"interrupted", "over", "unacknowledged"};
};

TEST_F(EarlierCommandsTest, AreKnownWhileTheDatabaseDoesNotOpen) {
  StoredJournal& journal = open_on_a_full_disk();
  EXPECT_EQ(ids_of(journal.known_ids()), all);
  EXPECT_EQ(ids_of(journal.known_ids("a")), all);
  EXPECT_EQ(ids_of(journal.known_ids("b")), Ids());
  EXPECT_EQ(shelf.found("over")->result, R"({"status":"SUCCEEDED"})");
  EXPECT_TRUE(journal.unacknowledged().empty()) << "nothing can record that they are published";
}

TEST_F(EarlierCommandsTest, GetTheirResultsWhenTheDatabaseOpens) {
  open_on_a_full_disk();
  shelf.store->upkeep(kStart, kNow);
  shelf.store->upkeep(kStart + Store::kTryAgain, kNow);
  ASSERT_FALSE(shelf.store->take_found_late());
  EXPECT_EQ(ids_of(shelf.store->journal().known_ids()), all) << "a further try did not open it";
  full.reset();
  shelf.store->upkeep(kStart + 2 * Store::kTryAgain, kNow);
  EXPECT_EQ(shelf.store->state(), "disk");
  const auto late = shelf.store->take_found_late();
  ASSERT_TRUE(late);
  EXPECT_EQ(late->ids.size(), 2U);
  EXPECT_EQ(late->unacknowledged.size(), 2U);
}

TEST_F(EarlierCommandsTest, InADirectoryThatOthersMayWriteAreNotRead) {
  shelf.store.reset();
  fs::permissions(shelf.config.path, fs::perms::all);
  Store second(shelf.config, kNow);
  EXPECT_EQ(second.state(), "memory");
  EXPECT_TRUE(second.journal().known_ids().empty());
}

TEST_F(EarlierCommandsTest, ThatTheDatabaseRefusedAreKnown) {
  full.emplace(4096);
  shelf.journal(shelf.arrived("refused"));
  EXPECT_EQ(shelf.store->state(), "memory");
  shelf.store.reset();
  EarlierCommands earlier(shelf.config.path);
  EXPECT_TRUE(ids_of(earlier.known_ids("a")).contains("refused"));
  EXPECT_FALSE(ids_of(earlier.known_ids("b")).contains("refused"));
}

TEST_F(EarlierCommandsTest, InALogWithoutItsIndexAreNotRead) {
  const std::string copy = shelf.scratch.path("copy #1");
  fs::create_directory(copy);
  for (const char* name : {"/fxagent.db", "/fxagent.db-wal"})
    fs::copy_file(shelf.config.path + name, copy + name);
  EXPECT_EQ(ids_of(EarlierCommands(copy).known_ids({})), all) << "the index can be made";
  fs::remove(copy + "/fxagent.db-shm");
  fs::copy_file(shelf.file() + "-wal", copy + "/fxagent.db-wal",
                fs::copy_options::overwrite_existing);
  const DiskLimit limit(4096);
  EXPECT_TRUE(EarlierCommands(copy).known_ids({}).empty());
}

TEST_F(EarlierCommandsTest, PipeDoesNotHoldUpTheStart) {
  shelf.store.reset();
  fs::remove(shelf.file());
  ASSERT_EQ(::mkfifo(shelf.file().c_str(), 0600), 0);
  EXPECT_TRUE(shelf.open().journal().known_ids().empty());
}

TEST_F(EarlierCommandsTest, ThatCannotBeReadAreLogged) {
  shelf.store.reset();
  fs::remove(shelf.file());
  std::ofstream(shelf.file()) << std::string(8192, 'x');
  fs::permissions(shelf.file(), fs::perms::owner_read);
  testing::internal::CaptureStderr();
  EXPECT_TRUE(EarlierCommands(shelf.config.path).known_ids({}).empty());
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_NE(log.find("commands of earlier runs are not known"), log.npos) << log;
}

}  // namespace
}  // namespace fxagent::test
