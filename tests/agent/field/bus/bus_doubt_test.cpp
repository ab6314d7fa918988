#include "agent/field/bus/bus_doubt.h"

#include <gtest/gtest.h>

namespace fxagent::test {
namespace {

using std::chrono::seconds;

const SteadyTime kStart = SteadyTime{} + std::chrono::hours(1);

void be_clean(BusDoubt& bus, std::uint32_t times, SteadyTime now) {
  for (std::uint32_t i = 0; i < times; ++i) bus.exchange_was_clean(now);
}

/// Returns the number of clean exchanges that have ended the doubt.
std::uint32_t end_doubt(BusDoubt& bus, SteadyTime now) {
  std::uint32_t count = 0;
  for (; bus.is_doubted(); ++count) bus.exchange_was_clean(now);
  return count;
}

TEST(BusDoubt, BusIsBelievedUntilForeignBytesAreHeard) {
  BusDoubt bus;
  EXPECT_FALSE(bus.is_doubted());
  bus.exchange_was_unclear();
  bus.exchange_was_clean(kStart);
  EXPECT_FALSE(bus.is_doubted()) << "bad frames are no foreign bytes";
  bus.found_foreign(kStart);
  EXPECT_TRUE(bus.is_doubted());
  EXPECT_EQ(bus.findings(), 1U);
  EXPECT_EQ(bus.doubts(), 1U);
}

TEST(BusDoubt, ThreeCleanExchangesInARowEndIt) {
  BusDoubt bus;
  bus.found_foreign(kStart);
  be_clean(bus, 2, kStart);
  EXPECT_TRUE(bus.is_doubted());
  bus.exchange_was_unclear();
  be_clean(bus, 2, kStart);
  EXPECT_TRUE(bus.is_doubted()) << "an unclear one begins the row anew";
  bus.found_foreign(kStart);
  be_clean(bus, 2, kStart);
  EXPECT_TRUE(bus.is_doubted()) << "and so do more foreign bytes";
  be_clean(bus, 1, kStart);
  EXPECT_FALSE(bus.is_doubted());
  EXPECT_EQ(bus.findings(), 2U);
  EXPECT_EQ(bus.doubts(), 1U) << "it was one doubt all the time";
}

TEST(BusDoubt, DoubtThatComesBackSoonTakesTwiceAsLongUpToALimit) {
  BusDoubt bus;
  SteadyTime now = kStart;
  for (const std::uint32_t wanted : {3U, 6U, 12U, 12U}) {
    bus.found_foreign(now);
    EXPECT_EQ(end_doubt(bus, now), wanted);
    now += seconds(59);
  }
}

TEST(BusDoubt, DoubtThatComesBackAfterAMinuteIsAFirstOne) {
  BusDoubt bus;
  for (int i = 0; i < 2; ++i) {
    bus.found_foreign(kStart);
    end_doubt(bus, kStart);
  }
  bus.found_foreign(kStart + BusDoubt::kRelapse);
  EXPECT_EQ(end_doubt(bus, kStart), BusDoubt::kCleanExchanges);
  EXPECT_EQ(bus.doubts(), 3U);
}

TEST(BusDoubt, WaryForAMinuteAfterTheLastForeignBytes) {
  BusDoubt bus;
  EXPECT_FALSE(bus.is_wary(SteadyTime{})) << "nothing was found yet";
  bus.found_foreign(kStart);
  end_doubt(bus, kStart);
  bus.found_foreign(kStart + seconds(30));
  end_doubt(bus, kStart + seconds(30));
  EXPECT_FALSE(bus.is_doubted());
  EXPECT_TRUE(bus.is_wary(kStart + seconds(89)));
  EXPECT_FALSE(bus.is_wary(kStart + seconds(90)));
}

TEST(BusDoubt, BusThatWasOutOfStepIsWaryAndBelieved) {
  BusDoubt bus;
  bus.was_out_of_step(kStart);
  EXPECT_FALSE(bus.is_doubted());
  EXPECT_EQ(bus.findings(), 0U);
  EXPECT_TRUE(bus.is_wary(kStart + seconds(59)));
  EXPECT_FALSE(bus.is_wary(kStart + seconds(60)));
}

}  // namespace
}  // namespace fxagent::test
