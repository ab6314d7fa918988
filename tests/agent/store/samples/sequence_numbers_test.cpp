#include "agent/store/samples/sequence_numbers.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "tests/agent/store/power_cut.h"
#include "tests/agent/store/shelf.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using namespace test;

TEST(SequenceNumbers, NumbersGoOnByOneAfterACleanStop) {
  OpenShelf shelf;
  EXPECT_EQ(shelf.begin(), static_cast<std::uint64_t>(kNow));
  shelf.store->numbers().used("a", kNow + 5);
  shelf.store->close();
  shelf.open();
  EXPECT_EQ(shelf.begin(kNow + 100000), static_cast<std::uint64_t>(kNow) + 5);
}

TEST(SequenceNumbers, DeviceThatJoinsLaterGoesOnWhereItsLastRunOrThisOneHasLeftIt) {
  OpenShelf shelf;
  const std::vector<std::string> both{"a", "b"};
  shelf.store->numbers().join(both, kNow);
  shelf.store->numbers().used("b", kNow + 9);
  shelf.store->close();
  shelf.open();
  shelf.begin(kNow + 100000);
  EXPECT_EQ(shelf.store->numbers().join(std::vector<std::string>{"b", "c"}, kNow + 200000),
            (std::vector<std::uint64_t>{kNow + 9, kNow + 200000}));
  shelf.store->numbers().used("b", kNow + 12);
  EXPECT_EQ(shelf.store->numbers().join(std::vector<std::string>{"b"}, kNow + 300000),
            std::vector<std::uint64_t>{kNow + 12});
  shelf.open(kNow + 400000);  // after a crash
  EXPECT_GT(shelf.store->numbers().join(both, kNow)[1], std::uint64_t{kNow} + 12);
}

TEST(SequenceNumbers, NumbersOnlySkipForwardAfterACrash) {
  OpenShelf shelf;
  std::uint64_t used = shelf.begin();
  for (const std::uint64_t blocks : {1U, 3U}) {
    for (std::uint64_t i = 0; i < blocks * SequenceNumbers::kBlock; ++i)
      shelf.store->numbers().used("a", ++used);
    // The clock was set back; the numbers continue.
    shelf.open(5);
    const std::uint64_t begun = shelf.begin(5);
    EXPECT_GT(begun, used) << "after " << blocks << " blocks";
    used = begun;
  }
}

// The file of an earlier run opens while this run, whose clock began in the past, is under way.
// Writing this run's low numbers must not hide the high numbers of the earlier run.
TEST(SequenceNumbers, NumbersOfAnEarlierRunAreNotSetBackByAFileThatOpensLate) {
  constexpr std::int64_t kBoot = 5000;
  OpenShelf shelf;
  const std::uint64_t reached = shelf.begin() + SequenceNumbers::kBlock;
  shelf.unmount();
  shelf.open(kBoot);
  ASSERT_EQ(shelf.begin(kBoot), static_cast<std::uint64_t>(kBoot));
  shelf.store->upkeep(kStart, kBoot);
  shelf.mount();
  shelf.store->upkeep(kStart + 10s, kBoot + 10000);
  ASSERT_EQ(shelf.store->state(), "disk");
  shelf.open(kBoot + 20000);  // after a crash
  EXPECT_GE(shelf.begin(kBoot + 20000), reached);
}

TEST(SequenceNumbers, NextBlockOfNumbersIsTakenWhileHalfOfTheLastOneIsLeft) {
  OpenShelf shelf;
  const std::uint64_t first = shelf.begin();
  shelf.store->numbers().used("a", first + SequenceNumbers::kBlock / 2);
  EXPECT_FALSE(shelf.store->has_pending());
  shelf.store->numbers().used("a", first + SequenceNumbers::kBlock / 2 + 1);
  EXPECT_TRUE(shelf.store->has_pending());
  shelf.store->upkeep(kStart, kNow);
  EXPECT_FALSE(shelf.store->has_pending());
  shelf.open();
  EXPECT_GE(shelf.begin(), first + 3 * SequenceNumbers::kBlock / 2);
}

TEST(SequenceNumbers, WithAlwaysNumbersGoOnByOneEvenAfterACrash) {
  AlwaysSyncedShelf shelf;
  const std::uint64_t last = shelf.begin();
  for (std::uint64_t seq = last + 1; seq < last + 4; ++seq) {
    shelf.store->numbers().used("a", seq);
    ASSERT_TRUE(shelf.add(rows(seq, seq)));
  }
  shelf.open();
  EXPECT_EQ(shelf.begin(kNow + 100000), last + 3);
}

TEST(SequenceNumbers, WithAlwaysNumbersThatTheDiskRefusedAreNotUsedAgain) {
  AlwaysSyncedShelf shelf;
  std::uint64_t last = shelf.begin();
  {
    const DiskLimit full(200000);
    do {
      ++last;
      shelf.store->numbers().used("a", last);
    } while (shelf.add(rows(last, last)));
    for (int i = 0; i < 1000; ++i) shelf.store->numbers().used("a", ++last);
  }  // power cut
  shelf.open(5);
  const std::uint64_t next = shelf.begin(5);
  EXPECT_GT(next, last);
  shelf.open();  // the mark is no longer needed
  EXPECT_EQ(shelf.begin(), next);
}

TEST(SequenceNumbers, MarkThatCouldNotBeMadeIsMadeWhenTheDiskIsTriedAgain) {
  AlwaysSyncedShelf shelf;
  std::uint64_t last = shelf.begin();
  const std::string in_the_way = shelf.config.path + "/fxagent.db.behind.new";
  std::filesystem::create_directory(in_the_way);
  {
    const DiskLimit full(1000);
    shelf.store->numbers().used("a", ++last);
    ASSERT_FALSE(shelf.add(rows(last, last)));
    EXPECT_FALSE(shelf.store->numbers().asks_disk("a", ++last)) << "not with every sample";
    std::filesystem::remove(in_the_way);
    shelf.store->numbers().used("a", last);
    EXPECT_FALSE(std::filesystem::exists(shelf.config.path + "/fxagent.db.behind"));
    shelf.store->upkeep(kStart, kNow);
    shelf.store->upkeep(kStart + 10s, kNow);
  }
  shelf.open(5);
  EXPECT_GT(shelf.begin(5), last);
}

TEST(SequenceNumbers, MarkCountsForADeviceThatHasLeftTheConfig) {
  const std::vector<std::string> both{"a", "b"};
  AlwaysSyncedShelf shelf;
  const std::uint64_t last = shelf.store->numbers().join(both, kNow)[1] + 1;
  {
    const DiskLimit full(1000);
    shelf.store->numbers().used("b", last);
    ASSERT_FALSE(shelf.add(rows(last, last, "b")));
  }
  shelf.open(5);
  shelf.begin(5);
  shelf.open(5);
  EXPECT_GT(shelf.store->numbers().join(both, 5)[1], last);
}

TEST(SequenceNumbers, NumbersThatAFullDiskDidNotReserveAreNotUsedAgain) {
  OpenShelf shelf;
  const std::uint64_t last = shelf.begin() + 2 * SequenceNumbers::kBlock;
  {
    const DiskLimit full(1000);
    shelf.store->numbers().used("a", last);
  }
  shelf.open(5);
  EXPECT_GT(shelf.begin(5), last);
}

TEST(SequenceNumbers, FirstNumbersOfARunOnAFullDiskAreNotUsedAgain) {
  constexpr std::int64_t kLater = kNow + 2 * SequenceNumbers::kBlock;
  OpenShelf shelf;
  shelf.begin();
  shelf.open(kLater);
  {
    const DiskLimit full(1000);
    ASSERT_EQ(shelf.begin(kLater), static_cast<std::uint64_t>(kLater));
  }
  shelf.open(5);
  EXPECT_GT(shelf.begin(5), static_cast<std::uint64_t>(kLater));
}

TEST(SequenceNumbers, NumbersOfADeviceThatJoinsOnAFullDiskAreNotUsedAgain) {
  const std::vector<std::string> both{"a", "b"};
  OpenShelf shelf;
  shelf.store->numbers().join(both, kNow);
  shelf.store->close();
  shelf.open(5);
  shelf.begin(5);
  std::uint64_t last = 0;
  {
    const DiskLimit full(1000);
    last = shelf.store->numbers().join(std::vector<std::string>{"b"}, 5)[0];
    shelf.store->numbers().used("b", ++last);
  }
  shelf.open(5);
  EXPECT_GT(shelf.store->numbers().join(both, 5)[1], last);
}

TEST(SequenceNumbers, NumbersOfAFileThatOpenedAreKnownIfTheDiskFailsAfterwards) {
  PowerCut disk;
  OpenShelf shelf;
  const std::uint64_t last = shelf.begin();
  shelf.store->close();
  shelf.open(5);
  disk.set_failing(true);
  EXPECT_EQ(shelf.begin(5), last);
}

TEST(SequenceNumbers, MarkCountsForAFileThatOpensLate) {
  const std::vector<std::string> both{"a", "b"};
  OpenShelf shelf;
  const std::uint64_t last =
      shelf.store->numbers().join(both, kNow)[0] + 2 * SequenceNumbers::kBlock;
  {
    const DiskLimit full(1000);
    for (const std::string& device : both) shelf.store->numbers().used(device, last);
  }
  shelf.unmount();
  shelf.open(5);
  shelf.begin(5);
  shelf.store->upkeep(kStart, 5);
  shelf.mount();
  shelf.store->upkeep(kStart + 10s, 10005);
  const auto late = shelf.store->take_found_late();
  ASSERT_TRUE(late);
  EXPECT_GT(late->numbers.at("a"), last);
  EXPECT_FALSE(std::filesystem::exists(shelf.config.path + "/fxagent.db.behind"));
  shelf.open(5);  // after a crash
  for (const std::uint64_t begun : shelf.store->numbers().join(both, 5)) EXPECT_GT(begun, last);
}

TEST(SequenceNumbers, MarkIsKeptByARunWithoutDevices) {
  AlwaysSyncedShelf shelf;
  const std::uint64_t last = shelf.begin() + 1;
  {
    const DiskLimit full(1000);
    shelf.store->numbers().used("a", last);
    ASSERT_FALSE(shelf.add(rows(last, last)));
  }
  for (int run = 0; run < 2; ++run) {
    shelf.open(5);
    EXPECT_TRUE(shelf.store->numbers().join({}, 5).empty());
    if (run == 0) shelf.store->close();
  }
  const std::uint64_t joined = shelf.begin(5);
  EXPECT_GT(joined, last);
  EXPECT_FALSE(std::filesystem::exists(shelf.config.path + "/fxagent.db.behind"));
  shelf.open(5);  // after a crash
  EXPECT_EQ(shelf.begin(5), joined);
}

TEST(SequenceNumbers, NumbersGoOnInTheFileThatTakesThePlaceOfADeletedOne) {
  OpenShelf shelf;
  const std::uint64_t last = shelf.begin() + 7;
  shelf.store->numbers().used("a", last);
  shelf.store->upkeep(kStart, kNow);
  std::filesystem::remove(shelf.file());
  shelf.store->upkeep(kStart + 60s, kNow);
  ASSERT_EQ(shelf.store->state(), "disk");
  EXPECT_EQ(shelf.begin(5), last) << "the same run";
  shelf.open(5);  // after a crash
  EXPECT_GT(shelf.begin(5), last);
}

TEST(SequenceNumbers, DeviceThatJoinsAfterItsFileOpenedLateGoesOnWhereItWasLeft) {
  const std::vector<std::string> both{"a", "b"};
  OpenShelf shelf;
  shelf.store->numbers().join(both, kNow);
  shelf.store->numbers().used("b", kNow + 9);
  shelf.store->close();
  shelf.unmount();
  shelf.open(5);
  shelf.begin(5);
  shelf.store->upkeep(kStart, 5);
  shelf.mount();
  shelf.store->upkeep(kStart + 10s, 10005);
  ASSERT_EQ(shelf.store->state(), "disk");
  EXPECT_EQ(shelf.store->numbers().join(std::vector<std::string>{"b"}, 20005),
            std::vector<std::uint64_t>{kNow + 9});
}

TEST(SequenceNumbers, NumbersThatTheDiskRefusedAreNoneBeforeTheClock) {
  constexpr std::int64_t kYear = std::int64_t{365} * 24 * 3600 * 1000;
  AlwaysSyncedShelf shelf;
  std::uint64_t last = shelf.begin();
  {
    const DiskLimit full(200000);
    do {
      ++last;
      shelf.store->numbers().used("a", last);
    } while (shelf.add(rows(last, last)));
  }
  shelf.open(kNow + kYear);
  EXPECT_GE(shelf.begin(kNow + kYear), static_cast<std::uint64_t>(kNow + kYear));
}

}  // namespace
}  // namespace fxagent
