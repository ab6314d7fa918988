#include "agent/remote/trial.h"

#include <gtest/gtest.h>

#include <chrono>

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using Verdict = Trial::Verdict;

constexpr SteadyTime kBegin{1h};
constexpr auto kLength = 60s;

TEST(Trial, AConnectionThatLastsProvesTheConfig) {
  const Trial trial(kLength, kBegin, /*is_connected=*/true);
  EXPECT_EQ(trial.decided_at(), kBegin + 60s);
  EXPECT_EQ(trial.verdict(kBegin + 59s), Verdict::pending);
  EXPECT_EQ(trial.verdict(kBegin + 60s), Verdict::good);
}

TEST(Trial, ABrokerThatNeverComesIsLost) {
  const Trial trial(kLength, kBegin, /*is_connected=*/false);
  EXPECT_EQ(trial.verdict(kBegin + 59s), Verdict::pending);
  EXPECT_EQ(trial.verdict(kBegin + 60s), Verdict::lost);
}

TEST(Trial, AShortOutageIsForgiven) {
  Trial trial(kLength, kBegin, true);
  trial.connection(false, kBegin + 10s);
  trial.connection(true, kBegin + 40s);
  EXPECT_EQ(trial.verdict(kBegin + 60s), Verdict::good);
}

TEST(Trial, AnOutageAtTheEndIsWaitedFor) {
  Trial trial(kLength, kBegin, true);
  trial.connection(false, kBegin + 50s);
  trial.connection(false, kBegin + 55s);  // a failed attempt: the same outage
  EXPECT_EQ(trial.verdict(kBegin + 60s), Verdict::pending);
  EXPECT_EQ(trial.decided_at(), kBegin + 110s);
  Trial back = trial;
  back.connection(true, kBegin + 100s);
  EXPECT_EQ(back.verdict(kBegin + 100s), Verdict::good);
  EXPECT_EQ(trial.verdict(kBegin + 110s), Verdict::lost);
}

TEST(Trial, EachOutageBeginsAnew) {
  Trial trial(kLength, kBegin, false);
  trial.connection(true, kBegin + 59s);
  trial.connection(false, kBegin + 59500ms);
  EXPECT_EQ(trial.verdict(kBegin + 61s), Verdict::pending);
  EXPECT_EQ(trial.verdict(kBegin + 119500ms), Verdict::lost);
}

}  // namespace
}  // namespace fxagent
