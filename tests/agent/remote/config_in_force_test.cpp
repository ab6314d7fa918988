#include "agent/remote/config_in_force.h"

#include <gtest/gtest.h>

#include <chrono>

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using Outcome = ConfigInForce::Outcome;

constexpr SteadyTime kBegan{1h};

ConfigInForce on_trial(bool is_connected) {
  ConfigInForce config(60s);
  config.connection(is_connected, kBegan - 10min);
  config.put_on_trial(KeptConfig{}, {}, kBegan);
  return config;
}

TEST(Trial, AConnectionThatLastsProvesTheConfig) {
  const ConfigInForce trial = on_trial(/*is_connected=*/true);
  EXPECT_EQ(trial.next_wake(), kBegan + 60s);
  EXPECT_EQ(trial.outcome(kBegan + 59s), Outcome::pending);
  EXPECT_EQ(trial.outcome(kBegan + 60s), Outcome::good);
}

TEST(Trial, ABrokerThatNeverComesIsLost) {
  const ConfigInForce trial = on_trial(/*is_connected=*/false);
  EXPECT_EQ(trial.outcome(kBegan + 59s), Outcome::pending);
  EXPECT_EQ(trial.outcome(kBegan + 60s), Outcome::lost);
}

TEST(Trial, AShortOutageIsForgiven) {
  ConfigInForce trial = on_trial(true);
  trial.connection(false, kBegan + 10s);
  trial.connection(true, kBegan + 40s);
  EXPECT_EQ(trial.outcome(kBegan + 60s), Outcome::good);
}

TEST(Trial, AnOutageAtTheEndIsWaitedFor) {
  ConfigInForce trial = on_trial(true);
  trial.connection(false, kBegan + 50s);
  trial.connection(false, kBegan + 55s);  // a failed attempt: the same outage
  EXPECT_EQ(trial.outcome(kBegan + 60s), Outcome::pending);
  EXPECT_EQ(trial.next_wake(), kBegan + 110s);
  ConfigInForce back = trial;
  back.connection(true, kBegan + 100s);
  EXPECT_EQ(back.outcome(kBegan + 100s), Outcome::good);
  EXPECT_EQ(trial.outcome(kBegan + 110s), Outcome::lost);
}

TEST(Trial, EachOutageBeginsAnew) {
  ConfigInForce trial = on_trial(false);
  trial.connection(true, kBegan + 59s);
  trial.connection(false, kBegan + 59500ms);
  EXPECT_EQ(trial.outcome(kBegan + 61s), Outcome::pending);
  EXPECT_EQ(trial.outcome(kBegan + 119500ms), Outcome::lost);
}

TEST(ConfigInForce, ALostTrialCanBePutOffAndAGoodOneIsNot) {
  ConfigInForce config(60s);
  EXPECT_EQ(config.next_wake(), SteadyTime::max());
  config.put_on_trial(KeptConfig{}, {}, kBegan);
  EXPECT_EQ(config.next_wake(), kBegan + 60s);
  EXPECT_EQ(config.outcome(kBegan + 60s), Outcome::lost);
  config.put_off(kBegan + 120s);
  EXPECT_EQ(config.next_wake(), kBegan + 120s);
  EXPECT_EQ(config.outcome(kBegan + 119s), Outcome::pending);
  EXPECT_EQ(config.outcome(kBegan + 120s), Outcome::lost);
  config.connection(true, kBegan + 90s);
  EXPECT_EQ(config.outcome(kBegan + 90s), Outcome::good);
}

TEST(ConfigInForce, OnlyATrialIsGivenUp) {
  ConfigInForce config(60s);
  config.connection(true, kBegan);
  config.give_up();
  EXPECT_FALSE(config.is_given_up());
  config.put_on_trial(KeptConfig{}, {}, kBegan);
  config.give_up();
  EXPECT_EQ(config.outcome(kBegan), Outcome::lost);
  config.put_in_force({}, {});
  EXPECT_FALSE(config.is_given_up());
  EXPECT_EQ(config.outcome(kBegan + 60s), Outcome::pending);
}

TEST(ConfigInForce, OnlyATrialThatMovedHoldsBackAnotherMove) {
  ConfigInForce config(60s);
  config.set_servers({"a"});
  config.put_on_trial(KeptConfig{}, {"a"}, kBegan);
  EXPECT_FALSE(config.would_move_again({"b"}));
  config.put_on_trial(KeptConfig{}, {"b"}, kBegan);
  EXPECT_TRUE(config.would_move_again({"a"}));
  EXPECT_FALSE(config.would_move_again({"b"}));
  config.end_trial();
  EXPECT_FALSE(config.would_move_again({"a"}));
}

}  // namespace
}  // namespace fxagent
