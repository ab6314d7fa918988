#include "agent/store/audit_trail.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "agent/commands/audit_records.h"
#include "tests/agent/store/shelf.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using namespace test;

TEST(AuditTrail, AuditOfACommandIsWrittenWithItsJournal) {
  OpenShelf shelf;
  JournalEntry command = entry("one");
  command.audit = told("one");
  command.number = 7;
  command.payload = "{}";
  ASSERT_TRUE(shelf.journal(command));
  EXPECT_EQ(audit_of(shelf).size(), 1U);
  EXPECT_EQ(shelf.store->journal().unacknowledged().at(0).number, 7U);
  EXPECT_EQ(shelf.store->journal().unacknowledged().at(0).payload, "{}");
  command.result = "{1}";
  shelf.record(command);
  EXPECT_EQ(audit_of(shelf).size(), 2U);
  EXPECT_EQ(shelf.store->journal().unacknowledged().at(0).payload, "");  // no longer needed
  EXPECT_EQ(shelf.store->audit().head().records, 2U);
}

TEST(AuditTrail, NotesForTheAuditAreWrittenTogether) {
  OpenShelf shelf;
  shelf.store->upkeep(kStart, kNow);
  for (const char* id : {"a", "b", "c"}) shelf.store->audit().note(told(id));
  EXPECT_TRUE(shelf.store->has_pending());
  EXPECT_EQ(shelf.store->audit().head().records, 0U);
  shelf.store->upkeep(kStart + 200ms, kNow + 200);
  EXPECT_FALSE(shelf.store->has_pending());
  EXPECT_EQ(audit_of(shelf).size(), 3U);
}

TEST(AuditTrail, AuditGoesOnAfterARestartAndCommandsKeepTheirNumbers) {
  OpenShelf shelf;
  EXPECT_EQ(shelf.store->audit().next_command_number(), 1U);
  EXPECT_EQ(shelf.store->audit().next_command_number(), 2U);
  shelf.store->audit().note(told("a"));
  shelf.store->close();
  EXPECT_EQ(audit_of(shelf).size(), 1U);  // readable without an agent
  shelf.open();
  EXPECT_EQ(shelf.store->audit().next_command_number(), 3U);
  shelf.store->audit().note(told("b"));
  shelf.store->upkeep(kStart, kNow);
  EXPECT_EQ(audit_of(shelf).size(), 2U);
}

TEST(AuditTrail, AuditThatFoundNoDiskIsWrittenLaterAndSaysWhatWasLost) {
  ShelfWithoutDisk shelf;
  JournalEntry command = entry("one");
  command.audit = told("one");
  EXPECT_FALSE(shelf.journal(command));
  for (int i = 0; i < 30005; ++i) shelf.store->audit().note(told("x"));
  std::filesystem::remove(shelf.config.path);
  shelf.store->upkeep(kStart, kNow);
  shelf.store->upkeep(kStart + 10s, kNow + 10000);
  const auto texts = audit_of(shelf);
  ASSERT_EQ(texts.size(), 30001U);
  expect_says(texts.front(), "\"one\"");
  expect_says(texts.back(), "\"kind\":\"lost\",\"ts\":1790000010000,\"records\":6");
}

TEST(AuditTrail, AuditOfAFreshFileNamesTheDamagedOne) {
  Shelf shelf;
  std::filesystem::create_directories(shelf.config.path);
  std::ofstream(shelf.file()) << std::string(8192, 'x');
  shelf.open();
  shelf.store->upkeep(kStart, kNow);
  const auto texts = audit_of(shelf);
  ASSERT_EQ(texts.size(), 1U);
  expect_says(texts[0], shelf.store->set_aside());
}

TEST(AuditTrail, AuditIsPrunedToItsSizeAndItsAge) {
  Shelf shelf;
  shelf.config.audit_max_bytes = 20000;
  shelf.config.audit_max_age = 1h;
  shelf.open();
  for (int i = 0; i < 500; ++i) shelf.store->audit().note(told("x"));
  shelf.store->upkeep(kStart, kNow);
  EXPECT_LT(audit_of(shelf).size(), 150U);
  EXPECT_GT(audit_of(shelf).size(), 50U);
  shelf.open(kNow + 7200000);
  shelf.store->upkeep(kStart, kNow + 7200000);
  // The last record has to stay, together with the record of the pruning.
  EXPECT_EQ(audit_of(shelf).size(), 2U);
}

TEST(AuditTrail, RecordsOfALongRunGoAfterTheirAge) {
  Shelf shelf;
  shelf.config.audit_max_age = 1h;
  shelf.open();
  for (int i = 0; i < 10; ++i) shelf.store->audit().note(told("x"));
  shelf.store->upkeep(kStart, kNow);
  shelf.store->upkeep(kStart + 50min, kNow + 3000000);
  EXPECT_EQ(audit_of(shelf).size(), 10U);
  shelf.store->upkeep(kStart + 111min, kNow + 6660000);
  EXPECT_EQ(audit_of(shelf).size(), 2U);
}

/// A trail in its own file, without a store.
struct TrailBench {
  Scratch scratch;
  StoreConfig config = in(scratch.path("s"));
  StoreDisk disk{config, kNow};
  AuditTrail trail{config, disk};

  static StoreConfig in(const std::string& directory) { return {.path = directory}; }
  TrailBench() {
    disk.set_parts({&trail});
    disk.open();
    EXPECT_TRUE(disk.is_writable());
  }
  ~TrailBench() { disk.close(); }
  TrailBench(const TrailBench&) = delete;
  TrailBench& operator=(const TrailBench&) = delete;

  bool commit(const StoreDisk::Work& work) {
    return disk.commit("audit", StoreDisk::Sync::as_configured, work);
  }
  void append(int count) {
    EXPECT_TRUE(commit([&] {
      for (int i = 0; i < count; ++i)
        trail.append(audit::delivery(1, "press1", "b7e1", true, kNow + i));
    }));
  }
  void prune(std::uint64_t max_bytes, std::int64_t oldest_ms, std::uint64_t may_age) {
    EXPECT_TRUE(commit([&] { trail.prune(max_bytes, oldest_ms, may_age); }));
  }
  std::vector<audit::Finding> findings() {
    audit::Verifier verifier;
    audit::Head head;
    EXPECT_FALSE(AuditTrail::read(
        store_file_path(config.path), [&](const audit::Record& record) { verifier.add(record); },
        head));
    left = verifier.records();
    return verifier.finish(head);
  }
  std::uint64_t left = 0;
};

TEST(AuditTrail, RecordsThatWereNotCommittedLeaveNoTrace) {
  TrailBench bench;
  bench.append(3);
  EXPECT_FALSE(bench.commit([&] {
    bench.trail.append(audit::delivery(1, "press1", "lost", true, kNow));
    bench.disk.database().exec("no SQL");
  }));
  bench.disk.try_to_write();
  bench.append(2);
  EXPECT_TRUE(bench.findings().empty());
  EXPECT_EQ(bench.left, 5U);
}

TEST(AuditTrail, IsReadOnAReadOnlyDiskUnlessItsNewestRecordsCannotBe) {
  TrailBench bench;
  bench.append(3);
  bench.disk.close();
  const std::string path = store_file_path(bench.config.path);
  std::filesystem::create_symlink("/", path + "-shm");  // SQLite cannot make this file
  EXPECT_TRUE(bench.findings().empty());
  EXPECT_EQ(bench.left, 3U);
  std::ofstream(path + "-wal") << "records";
  audit::Head head;
  EXPECT_TRUE(AuditTrail::read(
      path, [](const audit::Record&) {}, head));
}

TEST(AuditTrail, PrunesToItsSizeAndStaysWhole) {
  TrailBench bench;
  bench.append(1000);
  const std::uint64_t bytes = bench.trail.bytes();
  bench.prune(bytes, 0, 0);
  EXPECT_EQ(bench.trail.head().records, 1000U);
  bench.prune(bytes / 2, 0, 0);
  EXPECT_LE(bench.trail.bytes(), bytes / 2 + 500);
  EXPECT_TRUE(bench.findings().empty());
  EXPECT_NEAR(static_cast<double>(bench.left), 500.0, 5.0);
  bench.append(10);
  bench.prune(1, 0, 0);
  EXPECT_TRUE(bench.findings().empty());
  EXPECT_EQ(bench.left, 2U);
}

TEST(AuditTrail, PrunesWhatIsTooOldAndNothingOfAYoungRun) {
  TrailBench bench;
  bench.append(10);
  bench.prune(1 << 20, kNow + 5, 3);
  EXPECT_TRUE(bench.findings().empty());
  EXPECT_EQ(bench.left, 8U);  // 4 to 10, and the prune record
  bench.prune(1 << 20, kNow + 5, 100);
  EXPECT_TRUE(bench.findings().empty());
  EXPECT_EQ(bench.left, 7U);  // 6 to 11, and another prune record
}

TEST(AuditTrail, ChainGoesOnBehindAHeadThatWasPutBackAndTheBreakIsSeen) {
  TrailBench bench;
  bench.append(5);
  ASSERT_NO_THROW(bench.disk.database().exec("UPDATE audit_head SET records = 2"));
  bench.trail.load(bench.disk.database());
  bench.append(1);
  EXPECT_TRUE(bench.findings().empty());  // the hash is unchanged
  ASSERT_NO_THROW(bench.disk.database().exec("UPDATE audit_head SET hash = zeroblob(32)"));
  bench.trail.load(bench.disk.database());
  bench.append(1);
  ASSERT_EQ(bench.findings().size(), 1U);
  EXPECT_EQ(bench.findings()[0].record, 7U);
}

}  // namespace
}  // namespace fxagent
