#include <gtest/gtest.h>

#include <filesystem>

#include "tests/agent/store/shelf.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using namespace test;

constexpr std::int64_t kYear = std::int64_t{365} * 24 * 3600 * 1000;

/// Records an acknowledged command "known" while the clock is a year behind.
void record_known_a_year_ago(Shelf& shelf) {
  shelf.open(kNow - kYear);
  JournalEntry known = shelf.arrived("known", "{}", kNow - kYear);
  known.audit = told("known");  // the audit keeps the last command number
  shelf.record_acknowledged(known);
  shelf.store->upkeep(kStart, kNow - kYear);
}

TEST(StoreClock, ClockThatIsSetMakesNothingOlderOrYounger) {
  Shelf shelf;
  shelf.config.max_age = 1h;
  shelf.open(kNow - kYear);  // a gateway without a battery-backed clock
  shelf.store->upkeep(kStart, kNow - kYear);
  shelf.add(rows(1, 2));
  JournalEntry command = shelf.arrived("x", {}, kNow - kYear);
  ASSERT_TRUE(shelf.journal(command));
  shelf.store->upkeep(kStart + 30min, kNow + 1800000);
  shelf.store->upkeep(kStart + 60min, kNow + 3600000);
  EXPECT_TRUE(shelf.store->samples().take_dropped().empty());
  EXPECT_EQ(shelf.store->journal().unacknowledged().at(0).received_ms, kNow);
  EXPECT_EQ(shelf.store->journal().unacknowledged().at(0).deadline_ms, kNow + 10000);
  shelf.store->upkeep(kStart + 62min, kNow + 3720000);
  EXPECT_EQ(shelf.store->samples().take_dropped().at("a"), 2U);
}

TEST(StoreClock, ClockThatIsSetMovesCommandsOfEarlierRunsSinceTheMachineStarted) {
  Shelf shelf;
  record_known_a_year_ago(shelf);
  shelf.open(kNow - kYear + 1000);
  shelf.store->upkeep(kStart + 1s, kNow - kYear + 1000);
  shelf.store->upkeep(kStart + 2min, kNow + 120000);
  ASSERT_TRUE(shelf.found("known"));
  EXPECT_EQ(shelf.found("known")->received_ms, kNow);
}

TEST(StoreClock, ClockThatIsSetLeavesSamplesOfEarlierRunsAsTheyAre) {
  Shelf shelf;
  shelf.config.max_age = 1h;
  shelf.open();
  shelf.add(rows(1, 2));
  shelf.open(kNow + 1000);
  shelf.store->upkeep(kStart, kNow + 1000);
  shelf.add(rows(3, 3));
  shelf.store->upkeep(kStart + 2min, kNow + 4000000);
  EXPECT_EQ(shelf.store->samples().take_dropped().at("a"), 2U);
  EXPECT_EQ(shelf.drain(), "a/fast[3]}");
}

// A gateway without a battery-backed clock mounts its data partition late. Its command numbers
// begin below those of earlier runs, and the clock is set after the file has opened.
TEST(StoreClock, FileThatOpensBeforeTheClockIsSetKeepsItsOrderAndItsTimes) {
  constexpr std::int64_t kBoot = 5000;
  OpenShelf shelf;
  for (const char* id : {"told", "again", "untold"}) {
    JournalEntry made = entry(id, "{earlier}", kNow - 60000);
    made.number = static_cast<std::uint64_t>(kNow);  // like a run that opened its file late
    shelf.record(made);
    if (made.id != "untold") shelf.store->journal().acknowledge("a", id, made.number);
  }
  shelf.store->upkeep(kStart, kNow);
  shelf.unmount();
  shelf.open(kBoot);
  shelf.store->upkeep(kStart, kBoot);
  JournalEntry again = shelf.arrived("again", "", kBoot);
  EXPECT_FALSE(shelf.journal(again));
  shelf.mount();
  shelf.store->upkeep(kStart + 10s, kBoot + 10000);
  ASSERT_EQ(shelf.store->state(), "disk");
  EXPECT_EQ(shelf.found("again")->result, "");  // belongs to this run
  shelf.store->upkeep(kStart + 20s, kNow + 20000);
  shelf.store->upkeep(kStart + 21s, kNow + 21000);
  EXPECT_EQ(shelf.found("told")->received_ms, kNow - 60000);
  EXPECT_EQ(shelf.found("untold")->received_ms, kNow - 60000);
  EXPECT_EQ(shelf.found("again")->received_ms, kNow);
  const auto ids = shelf.store->journal().known_ids();
  ASSERT_EQ(ids.size(), 2U);
  EXPECT_EQ(ids[0].id, "told");
}

// Otherwise their commands would count as old, and a repeat of one would be carried out.
TEST(StoreClock, IdsOfAFileThatOpensAfterTheClockIsSetAreNotOld) {
  Shelf shelf;
  record_known_a_year_ago(shelf);
  shelf.unmount();
  shelf.open(kNow - kYear + 1000);
  shelf.store->upkeep(kStart + 1s, kNow - kYear + 1000);
  shelf.store->upkeep(kStart + 2s, kNow + 2000);
  shelf.mount();
  shelf.store->upkeep(kStart + 12s, kNow + 12000);
  const auto found = shelf.store->take_found_late();
  ASSERT_TRUE(found);
  ASSERT_EQ(found->ids.size(), 1U);
  EXPECT_EQ(found->ids[0].received_ms, kNow);
}

TEST(StoreClock, ClockThatIsSetTwiceWithoutADiskMovesWhatWasThere) {
  constexpr std::int64_t kHour = 3600000;
  ShelfWithoutDisk shelf;
  shelf.store->upkeep(kStart, kNow);
  const auto journal = [&](const char* id, std::int64_t at) {
    JournalEntry made = shelf.arrived(id, "", at);
    shelf.journal(made);
  };
  journal("first", kNow);
  shelf.store->upkeep(kStart + 1s, kNow + 30 * kHour + 1000);
  journal("between", kNow + 30 * kHour + 1000);
  shelf.store->upkeep(kStart + 2s, kNow - 50 * kHour + 2000);
  journal("last", kNow - 50 * kHour + 2000);
  std::filesystem::remove(shelf.config.path);
  shelf.store->upkeep(kStart + 20s, kNow - 50 * kHour + 20000);
  ASSERT_EQ(shelf.store->state(), "disk");
  EXPECT_EQ(shelf.found("first")->received_ms, kNow - 50 * kHour);
  EXPECT_EQ(shelf.found("between")->received_ms, kNow - 50 * kHour + 1000);
  EXPECT_EQ(shelf.found("last")->received_ms, kNow - 50 * kHour + 2000);
}

}  // namespace
}  // namespace fxagent
