// The store's guarantees at power cuts, on a disk that loses unsynced data.
#include <gtest/gtest.h>

#include <memory>

#include "agent/store/store.h"
#include "tests/agent/store/power_cut.h"
#include "tests/agent/store/shelf.h"
#include "tests/agent/store/synced_files.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;

constexpr std::int64_t kNow = 1790000000000;
const SteadyTime kStart{std::chrono::hours(1)};

std::vector<SampleRow> rows(std::uint64_t from, std::uint64_t to) {
  std::vector<SampleRow> made;
  for (std::uint64_t seq = from; seq <= to; ++seq)
    made.push_back({0, "a", "fast", seq, std::to_string(seq), RowFormat::json_text});
  return made;
}

JournalEntry entry(std::string id, std::uint64_t number, std::string result = {}) {
  JournalEntry made;
  made.device = "a";
  made.id = std::move(id);
  made.received_ms = kNow;
  made.deadline_ms = kNow + 10000;
  made.op = "write";
  made.number = number;
  made.result = std::move(result);
  return made;
}

class StorePower : public ::testing::Test {
 protected:
  StorePower() { config.path = scratch.path("store"); }

  Store& open(std::int64_t utc_ms = kNow) {
    store = std::make_unique<Store>(config, utc_ms);
    return *store;
  }

  /// Cuts the power and opens what the disk has kept.
  Store& power_cut(std::int64_t utc_ms = kNow) {
    StoreConfig after = config;
    after.path = scratch.path("after-" + std::to_string(++cuts));
    disk.leave(config.path, after.path);
    plain.leave(config.path, after.path, "fxagent.db.behind");
    config = after;
    store.reset();  // the closing checkpoint does not reach the copy
    return open(utc_ms);
  }

  test::Scratch scratch;
  test::PowerCut disk;
  test::SyncedFiles plain;
  StoreConfig config;
  std::unique_ptr<Store> store;
  int cuts = 0;
};

TEST_F(StorePower, DiskOfTheTestLosesWhatWasNotSynchronised) {
  Store& first = open();
  auto kept = rows(1, 3);
  ASSERT_TRUE(first.samples().append(kept, Store::Hold::no));
  // With `offline` a command alone causes no sync.
  ASSERT_TRUE(first.journal().journal(std::vector{entry("lost", 1)}));
  EXPECT_TRUE(first.journal().find("a", "lost"));
  Store& again = power_cut();
  EXPECT_FALSE(again.journal().find("a", "lost"));
}

TEST_F(StorePower, SamplesThatCountAsStoredAreThereAfterAPowerCut) {
  Store& first = open();
  for (std::uint64_t i = 0; i < 5; ++i) {
    auto batch = rows(10 * i + 1, 10 * i + 10);
    const auto before = disk.syncs("-wal");
    ASSERT_TRUE(first.samples().append(batch, Store::Hold::no));
    EXPECT_GT(disk.syncs("-wal"), before);
  }
  EXPECT_EQ(power_cut().samples().rows(), 50U);
}

TEST_F(StorePower, NoSequenceNumberComesTwiceAfterAPowerCut) {
  Store& first = open();
  const std::vector<std::string> devices{"a"};
  std::uint64_t last = first.numbers().begin(devices, 1000).at(0);
  EXPECT_EQ(last, 1000U);
  // Reaches the third block; each block was reserved on the way.
  for (std::uint64_t i = 0; i < 2 * SequenceNumbers::kBlock + 500; ++i) {
    first.numbers().used("a", ++last);
    first.upkeep(kStart + i * 1ms, kNow + static_cast<std::int64_t>(i));
  }
  // The next boot's clock is below every number used.
  EXPECT_GE(power_cut().numbers().begin(devices, 1000).at(0), last);
}

TEST_F(StorePower, WithAlwaysEveryCommandAndResultIsThereAfterAPowerCut) {
  config.sync_always = true;
  Store& first = open();
  ASSERT_TRUE(first.journal().journal(std::vector{entry("waits", 1)}));
  first.journal().record(entry("done", 2, R"({"status":"SUCCEEDED"})"));
  Store& again = power_cut();
  ASSERT_TRUE(again.journal().find("a", "waits"));
  ASSERT_TRUE(again.journal().find("a", "done"));
  EXPECT_EQ(again.journal().find("a", "done")->result, R"({"status":"SUCCEEDED"})");
}

TEST_F(StorePower, WithAlwaysNumbersGoOnByOneAfterAPowerCut) {
  config.sync_always = true;
  Store& first = open();
  const std::vector<std::string> devices{"a"};
  ASSERT_EQ(first.numbers().begin(devices, 1000).at(0), 1000U);
  auto batch = rows(1001, 1007);
  ASSERT_TRUE(first.samples().append(batch, Store::Hold::no));
  Store& again = power_cut();
  EXPECT_EQ(again.samples().rows(), 7U);
  EXPECT_EQ(again.numbers().begin(devices, 1000).at(0), 1007U);
}

TEST_F(StorePower, WithAlwaysNumbersThatTheDiskRefusedDoNotComeTwiceAfterAPowerCut) {
  config.sync_always = true;
  Store& first = open();
  const std::vector<std::string> devices{"a"};
  std::uint64_t last = first.numbers().begin(devices, 1000).at(0);
  {
    const test::DiskLimit full(200000);
    for (bool taken = true; taken;) {
      first.numbers().used("a", ++last);
      auto batch = rows(last, last);
      taken = first.samples().append(batch, Store::Hold::no);
    }
    first.numbers().used("a", last += 1000);
  }
  EXPECT_GT(power_cut(5).numbers().begin(devices, 5).at(0), last);
}

}  // namespace
}  // namespace fxagent
