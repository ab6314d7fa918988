#include "agent/handover/field_health.h"

#include <gtest/gtest.h>

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;

TEST(PercentileWindow, NothingMeasuredIsZero) {
  const Percentiles percentiles = PercentileWindow().percentiles();
  EXPECT_EQ(percentiles.p50, 0.0);
  EXPECT_EQ(percentiles.p99, 0.0);
}

TEST(PercentileWindow, OneMeasurementIsAllOfThem) {
  PercentileWindow window;
  window.add(milliseconds(7));
  EXPECT_FLOAT_EQ(static_cast<float>(window.percentiles().p50), 7.0F);
  EXPECT_FLOAT_EQ(static_cast<float>(window.percentiles().p99), 7.0F);
}

TEST(PercentileWindow, OrderOfArrivalDoesNotMatter) {
  PercentileWindow window;
  for (int i = 100; i > 0; --i) window.add(milliseconds(i));
  EXPECT_NEAR(window.percentiles().p50, 50.0, 1.0);
  EXPECT_NEAR(window.percentiles().p99, 100.0, 1.0);
}

TEST(PercentileWindow, OldMeasurementsMakeRoomForNewOnes) {
  PercentileWindow window;
  for (int i = 0; i < 1000; ++i) window.add(milliseconds(500));
  for (int i = 0; i < 256; ++i) window.add(milliseconds(1));
  EXPECT_NEAR(window.percentiles().p99, 1.0, 0.001);
}

}  // namespace
}  // namespace fxagent::test
