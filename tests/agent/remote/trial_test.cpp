#include "agent/remote/config_in_force.h"

#include <gtest/gtest.h>

#include <chrono>

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using Outcome = Trial::Outcome;

constexpr SteadyTime kBegin{1h};
constexpr auto kLength = 60s;

TEST(Trial, AConnectionThatLastsProvesTheConfig) {
  const Trial trial(kLength, kBegin, /*is_connected=*/true);
  EXPECT_EQ(trial.decided_at(), kBegin + 60s);
  EXPECT_EQ(trial.outcome(kBegin + 59s), Outcome::pending);
  EXPECT_EQ(trial.outcome(kBegin + 60s), Outcome::good);
}

TEST(Trial, ABrokerThatNeverComesIsLost) {
  const Trial trial(kLength, kBegin, /*is_connected=*/false);
  EXPECT_EQ(trial.outcome(kBegin + 59s), Outcome::pending);
  EXPECT_EQ(trial.outcome(kBegin + 60s), Outcome::lost);
}

TEST(Trial, AShortOutageIsForgiven) {
  Trial trial(kLength, kBegin, true);
  trial.connection(false, kBegin + 10s);
  trial.connection(true, kBegin + 40s);
  EXPECT_EQ(trial.outcome(kBegin + 60s), Outcome::good);
}

TEST(Trial, AnOutageAtTheEndIsWaitedFor) {
  Trial trial(kLength, kBegin, true);
  trial.connection(false, kBegin + 50s);
  trial.connection(false, kBegin + 55s);  // a failed attempt: the same outage
  EXPECT_EQ(trial.outcome(kBegin + 60s), Outcome::pending);
  EXPECT_EQ(trial.decided_at(), kBegin + 110s);
  Trial back = trial;
  back.connection(true, kBegin + 100s);
  EXPECT_EQ(back.outcome(kBegin + 100s), Outcome::good);
  EXPECT_EQ(trial.outcome(kBegin + 110s), Outcome::lost);
}

TEST(Trial, EachOutageBeginsAnew) {
  Trial trial(kLength, kBegin, false);
  trial.connection(true, kBegin + 59s);
  trial.connection(false, kBegin + 59500ms);
  EXPECT_EQ(trial.outcome(kBegin + 61s), Outcome::pending);
  EXPECT_EQ(trial.outcome(kBegin + 119500ms), Outcome::lost);
}

}  // namespace
}  // namespace fxagent
