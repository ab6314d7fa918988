#include "agent/remote/config_in_force.h"

#include <gtest/gtest.h>

#include <chrono>

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using Outcome = ConfigInForce::Outcome;

constexpr SteadyTime kBegin{1h};
constexpr auto kLength = 60s;

ConfigInForce trial_from_begin(bool is_connected) {
  ConfigInForce config(kLength);
  config.connection(is_connected, kBegin - 10min);
  config.put_on_trial(KeptConfig{}, {}, kBegin);
  return config;
}

TEST(Trial, AConnectionThatLastsProvesTheConfig) {
  const ConfigInForce trial = trial_from_begin(/*is_connected=*/true);
  EXPECT_EQ(trial.next_wake(), kBegin + 60s);
  EXPECT_EQ(trial.outcome(kBegin + 59s), Outcome::pending);
  EXPECT_EQ(trial.outcome(kBegin + 60s), Outcome::good);
}

TEST(Trial, ABrokerThatNeverComesIsLost) {
  const ConfigInForce trial = trial_from_begin(/*is_connected=*/false);
  EXPECT_EQ(trial.outcome(kBegin + 59s), Outcome::pending);
  EXPECT_EQ(trial.outcome(kBegin + 60s), Outcome::lost);
}

TEST(Trial, AShortOutageIsForgiven) {
  ConfigInForce trial = trial_from_begin(true);
  trial.connection(false, kBegin + 10s);
  trial.connection(true, kBegin + 40s);
  EXPECT_EQ(trial.outcome(kBegin + 60s), Outcome::good);
}

TEST(Trial, AnOutageAtTheEndIsWaitedFor) {
  ConfigInForce trial = trial_from_begin(true);
  trial.connection(false, kBegin + 50s);
  trial.connection(false, kBegin + 55s);  // a failed attempt: the same outage
  EXPECT_EQ(trial.outcome(kBegin + 60s), Outcome::pending);
  EXPECT_EQ(trial.next_wake(), kBegin + 110s);
  ConfigInForce back = trial;
  back.connection(true, kBegin + 100s);
  EXPECT_EQ(back.outcome(kBegin + 100s), Outcome::good);
  EXPECT_EQ(trial.outcome(kBegin + 110s), Outcome::lost);
}

TEST(Trial, EachOutageBeginsAnew) {
  ConfigInForce trial = trial_from_begin(false);
  trial.connection(true, kBegin + 59s);
  trial.connection(false, kBegin + 59500ms);
  EXPECT_EQ(trial.outcome(kBegin + 61s), Outcome::pending);
  EXPECT_EQ(trial.outcome(kBegin + 119500ms), Outcome::lost);
}

}  // namespace
}  // namespace fxagent
