#include "agent/field/poll/group_schedule.h"

#include <gtest/gtest.h>

namespace fxagent::test {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;

SteadyTime at(nanoseconds since) { return SteadyTime(since); }

TEST(PollGrid, SpacingIsAtMostAHundredthOfTheIntervalAndTenMilliseconds) {
  EXPECT_EQ(grid_of(milliseconds(100)), milliseconds(1));
  EXPECT_EQ(grid_of(milliseconds(199)), milliseconds(1));
  EXPECT_EQ(grid_of(milliseconds(200)), milliseconds(2));
  EXPECT_EQ(grid_of(milliseconds(500)), milliseconds(5));
  EXPECT_EQ(grid_of(milliseconds(1000)), milliseconds(10));
  EXPECT_EQ(grid_of(milliseconds(3600000)), milliseconds(10));
}

TEST(PollGrid, SpacingDividesTheInterval) {
  for (int interval = 100; interval <= 5000; ++interval)
    EXPECT_EQ(interval % grid_of(milliseconds(interval)).count(), 0) << interval;
  EXPECT_EQ(grid_of(milliseconds(1001)), milliseconds(1));
  EXPECT_EQ(grid_of(milliseconds(1234)), milliseconds(2));
}

TEST(PollGrid, ShortIntervalsHaveNone) {
  EXPECT_EQ(grid_of(milliseconds(99)), milliseconds(0));
  EXPECT_EQ(grid_of(milliseconds(0)), milliseconds(0));
  EXPECT_EQ(on_grid(at(microseconds(12345)), milliseconds(50)), at(microseconds(12345)));
}

TEST(PollGrid, MovesToTheNextMomentAndNeverBack) {
  EXPECT_EQ(on_grid(at(milliseconds(30)), milliseconds(1000)), at(milliseconds(30)));
  EXPECT_EQ(on_grid(at(nanoseconds(30000001)), milliseconds(1000)), at(milliseconds(40)));
  EXPECT_EQ(on_grid(at(microseconds(39999)), milliseconds(1000)), at(milliseconds(40)));
}

TEST(PollGrid, CyclesOfAllIntervalsMeetOnTheFinestGrid) {
  for (const int interval : {100, 250, 1000, 60000}) {
    const SteadyTime first = on_grid(at(microseconds(777777)), milliseconds(interval));
    const SteadyTime later = first + 7 * milliseconds(interval);
    EXPECT_EQ(later.time_since_epoch() % milliseconds(1), nanoseconds(0)) << interval;
  }
}

}  // namespace
}  // namespace fxagent::test
