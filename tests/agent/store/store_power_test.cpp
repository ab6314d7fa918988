// The store's guarantees at power cuts, on a disk that loses unsynced data.
#include <gtest/gtest.h>

#include "agent/store/store.h"
#include "tests/agent/store/power_cut.h"
#include "tests/agent/store/shelf.h"
#include "tests/agent/store/synced_files.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using namespace test;

struct StorePower : ::testing::Test {
  /// Cuts the power and opens what the disk has kept.
  Store& power_cut(std::int64_t utc_ms = kNow) {
    const std::string before = shelf.config.path;
    shelf.config.path = shelf.scratch.path("after-" + std::to_string(++cuts));
    disk.leave(before, shelf.config.path);
    plain.leave(before, shelf.config.path, "fxagent.db.behind");
    return shelf.open(utc_ms);  // the closing checkpoint does not reach the copy
  }

  PowerCut disk;
  SyncedFiles plain;
  Shelf shelf;
  int cuts = 0;
};

TEST_F(StorePower, DiskOfTheTestLosesWhatWasNotSynchronised) {
  Store& first = shelf.open();
  ASSERT_TRUE(shelf.add(rows(1, 3)));
  // With `offline` a command alone causes no sync.
  ASSERT_TRUE(first.journal().journal(std::vector{shelf.arrived("lost")}));
  EXPECT_TRUE(first.journal().find("a", "lost"));
  Store& again = power_cut();
  EXPECT_FALSE(again.journal().find("a", "lost"));
}

TEST_F(StorePower, SamplesThatCountAsStoredAreThereAfterAPowerCut) {
  shelf.open();
  for (std::uint64_t i = 0; i < 5; ++i) {
    const auto before = disk.syncs("-wal");
    ASSERT_TRUE(shelf.add(rows(10 * i + 1, 10 * i + 10)));
    EXPECT_GT(disk.syncs("-wal"), before);
  }
  EXPECT_EQ(power_cut().samples().rows(), 50U);
}

TEST_F(StorePower, NoSequenceNumberComesTwiceAfterAPowerCut) {
  Store& first = shelf.open();
  std::uint64_t last = shelf.begin(1000);
  EXPECT_EQ(last, 1000U);
  // Reaches the third block; each block was reserved on the way.
  for (std::uint64_t i = 0; i < 2 * SequenceNumbers::kBlock + 500; ++i) {
    first.numbers().used("a", ++last);
    first.upkeep(kStart + i * 1ms, kNow + static_cast<std::int64_t>(i));
  }
  // The next boot's clock is below every number used.
  power_cut();
  EXPECT_GE(shelf.begin(1000), last);
}

TEST_F(StorePower, WithAlwaysEveryCommandAndResultIsThereAfterAPowerCut) {
  shelf.config.sync_always = true;
  Store& first = shelf.open();
  ASSERT_TRUE(first.journal().journal(std::vector{shelf.arrived("waits")}));
  first.journal().record(shelf.arrived("done", R"({"status":"SUCCEEDED"})"));
  Store& again = power_cut();
  ASSERT_TRUE(again.journal().find("a", "waits"));
  ASSERT_TRUE(again.journal().find("a", "done"));
  EXPECT_EQ(again.journal().find("a", "done")->result, R"({"status":"SUCCEEDED"})");
}

TEST_F(StorePower, WithAlwaysNumbersGoOnByOneAfterAPowerCut) {
  shelf.config.sync_always = true;
  shelf.open();
  ASSERT_EQ(shelf.begin(1000), 1000U);
  ASSERT_TRUE(shelf.add(rows(1001, 1007)));
  Store& again = power_cut();
  EXPECT_EQ(again.samples().rows(), 7U);
  EXPECT_EQ(shelf.begin(1000), 1007U);
}

TEST_F(StorePower, WithAlwaysNumbersThatTheDiskRefusedDoNotComeTwiceAfterAPowerCut) {
  shelf.config.sync_always = true;
  Store& first = shelf.open();
  std::uint64_t last = shelf.begin(1000);
  {
    const DiskLimit full(200000);
    for (bool taken = true; taken;) {
      first.numbers().used("a", ++last);
      taken = shelf.add(rows(last, last));
    }
    first.numbers().used("a", last += 1000);
  }
  power_cut(5);
  EXPECT_GT(shelf.begin(5), last);
}

}  // namespace
}  // namespace fxagent
