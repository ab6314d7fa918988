#include "agent/log/recent_events.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

using log::events_after;

std::uint64_t newest() {
  const auto events = events_after(0, 1);
  return events.empty() ? 0 : events.back().number;
}

struct RecentEvents : testing::Test {
  void SetUp() override {
    log::keep_events();
    log::set_level(log::Level::error);  // events are kept whatever is written
    log::info("mark", {{"test", testing::UnitTest::GetInstance()->current_test_info()->name()}});
    before_ = newest();
  }
  void TearDown() override { log::set_level(log::Level::info); }

  std::uint64_t before_ = 0;
};

TEST_F(RecentEvents, EventsComeInTheirOrderWithLevelAndFields) {
  log::info("device", {{"device", "press1"}, {"state", "online"}, {"reason", ""}});
  log::warn("broker", {{"why", "no route"}});
  log::debug("frame", {{"bytes", "7"}});
  const auto events = events_after(before_, 10);
  ASSERT_EQ(events.size(), 2U) << "debug is not kept";
  EXPECT_EQ(events[0].name, "device");
  EXPECT_EQ(events[0].text, "device=press1 state=online reason=\"\"");
  EXPECT_EQ(events[0].level, log::Level::info);
  EXPECT_EQ(events[1].text, "why=\"no route\"");
  EXPECT_EQ(events[1].level, log::Level::warn);
  EXPECT_LT(events[0].number, events[1].number);
  EXPECT_LE(events[0].ts_ms, events[1].ts_ms);
  EXPECT_TRUE(events_after(events[1].number, 10).empty());
}

TEST_F(RecentEvents, EqualEventsInARowAreOneWithACount) {
  for (int i = 0; i < 5; ++i) log::info("link", {{"state", "down"}});
  const auto first = events_after(before_, 10);
  ASSERT_EQ(first.size(), 1U);
  EXPECT_EQ(first[0].count, 5U);
  log::info("link", {{"state", "down"}});
  const auto next = events_after(first[0].number, 10);
  ASSERT_EQ(next.size(), 1U) << "a reader of the fifth sees the sixth";
  EXPECT_EQ(next[0].count, 6U);
}

TEST_F(RecentEvents, OnlyTheNewestAreGivenAndKept) {
  for (std::size_t i = 0; i < log::kMostEvents + 10; ++i)
    log::info("count", {{"n", std::to_string(i)}});
  EXPECT_EQ(events_after(0, 100'000).size(), log::kMostEvents);
  const auto three = events_after(before_, 3);
  ASSERT_EQ(three.size(), 3U);
  EXPECT_EQ(three.back().text, "n=" + std::to_string(log::kMostEvents + 9));
}

TEST_F(RecentEvents, LongTextsPushOutOldOnes) {
  const std::string text(1000, 'x');
  for (std::size_t i = 0; i < 2000; ++i)
    log::info("long", {{"n", std::to_string(i)}, {"text", text}});
  std::size_t bytes = 0;
  for (const log::Event& event : events_after(0, 100'000)) bytes += event.text.size();
  EXPECT_LE(bytes, log::kMostEventBytes);
  EXPECT_GT(bytes, log::kMostEventBytes / 2);
}

}  // namespace
}  // namespace fxagent
