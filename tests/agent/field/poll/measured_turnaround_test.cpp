#include "agent/field/poll/measured_turnaround.h"

#include <gtest/gtest.h>

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;

void add(MeasuredTurnaround& turnaround, int times, milliseconds measured) {
  for (int i = 0; i < times; ++i) turnaround.add(measured);
}

TEST(MeasuredTurnaround, IsWhatTheConfigSaysUntilEnoughWasMeasured) {
  MeasuredTurnaround turnaround(milliseconds(5));
  add(turnaround, 63, milliseconds(20));
  EXPECT_FALSE(turnaround.review());
  EXPECT_EQ(turnaround.value(), milliseconds(5));
  add(turnaround, 1, milliseconds(20));
  EXPECT_TRUE(turnaround.review());
  EXPECT_EQ(turnaround.value(), milliseconds(20));
  EXPECT_FALSE(turnaround.review()) << "the count begins anew";
}

TEST(MeasuredTurnaround, IsTheMean) {
  MeasuredTurnaround turnaround(milliseconds(5));
  add(turnaround, 32, milliseconds(10));
  add(turnaround, 32, milliseconds(30));
  EXPECT_TRUE(turnaround.review());
  EXPECT_EQ(turnaround.value(), milliseconds(20));
}

TEST(MeasuredTurnaround, NoiseAndSmallDifferencesChangeNothing) {
  MeasuredTurnaround quick(milliseconds(1));
  add(quick, 64, milliseconds(4));
  EXPECT_FALSE(quick.review()) << "four times as long, and yet only 3 ms";
  MeasuredTurnaround slow(milliseconds(100));
  add(slow, 64, milliseconds(150));
  EXPECT_FALSE(slow.review()) << "50 ms more, and yet only half as long again";
  add(slow, 64, milliseconds(66));
  EXPECT_TRUE(slow.review()) << "a shorter one counts as well";
  EXPECT_EQ(slow.value(), milliseconds(66));
}

TEST(MeasuredTurnaround, WhatWasReviewedDoesNotCountAgain) {
  MeasuredTurnaround turnaround(milliseconds(5));
  add(turnaround, 64, milliseconds(6));
  EXPECT_FALSE(turnaround.review());
  add(turnaround, 64, milliseconds(50));
  EXPECT_TRUE(turnaround.review());
  EXPECT_EQ(turnaround.value(), milliseconds(50));
}

}  // namespace
}  // namespace fxagent::test
