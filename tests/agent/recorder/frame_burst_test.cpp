#include <gtest/gtest.h>

#include "agent/recorder/flight_recorder.h"

namespace fxagent {
namespace {

using std::chrono::seconds;

TEST(FrameBurst, FiveWithinAMinuteAreOneBurst) {
  FrameBurst burst;
  const SteadyTime begin{};
  for (std::uint64_t i = 1; i < FrameBurst::kFrames; ++i)
    EXPECT_FALSE(burst.add(i, begin + seconds(i)));
  EXPECT_FALSE(burst.add(4, begin + seconds(5))) << "nothing new";
  EXPECT_TRUE(burst.add(5, begin + seconds(6)));
  EXPECT_FALSE(burst.add(6, begin + seconds(7))) << "the next burst begins";
  EXPECT_TRUE(burst.add(10, begin + seconds(8)));
}

TEST(FrameBurst, AFewOverALongTimeAreNone) {
  FrameBurst burst;
  for (std::uint64_t i = 1; i <= 100; ++i)
    EXPECT_FALSE(burst.add(i, SteadyTime() + seconds(20 * i))) << i;
}

TEST(FrameBurst, ManyAtOnceAreABurst) { EXPECT_TRUE(FrameBurst().add(5, SteadyTime())); }

}  // namespace
}  // namespace fxagent
