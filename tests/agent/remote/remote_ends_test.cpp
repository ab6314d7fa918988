// The effect of a process's end on the remote config that was in force or being judged.
#include <gtest/gtest.h>

#include "tests/agent/remote/remote_run.h"

namespace fxagent {
namespace {

using namespace test;

constexpr const char* kEndedTwice =
    "the process ended twice within an hour of its start while the config was in force";

struct RemoteEndsTest : ::testing::Test {
  Plant plant;
};

/// Two configs are good: v1 with 7 retries, then v2 with 8.
struct RemoteEndsAfterTwoGood : RemoteEndsTest {
  void SetUp() override {
    plant.hear(plant.with_retries("v1", 7));
    plant.pass(kTrial);
    plant.hear(plant.with_retries("v2", 8));
    plant.pass(kTrial);
    ASSERT_EQ(plant.reported()["confirmed"], true);
  }
};

/// A PLC that was off during the trial now answers, with more data than the machine can hold.
TEST_F(RemoteEndsAfterTwoGood, AGoodOneThatEndsTheProcessTwiceIsSetAside) {
  plant.start();
  EXPECT_EQ(plant.retries(), 8);
  plant.pass(59min);
  plant.start();
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_EQ(plant.said(), std::string("rolled_back \"v2\": ") + kEndedTwice);
  EXPECT_EQ(plant.reported()["in_force"], "v1");
  EXPECT_FALSE(plant.hear(plant.with_retries("v2", 8)));
  EXPECT_EQ(plant.said().substr(0, 16), "rolled_back \"v2\"");
}

TEST_F(RemoteEndsAfterTwoGood, TheOneBeforeIsSetAsideInTheSameWay) {
  for (int ends = 0; ends < 3; ++ends) plant.start();
  EXPECT_EQ(plant.retries(), 7);
  plant.start();
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.said(), std::string("rolled_back \"v1\": ") + kEndedTwice);
  EXPECT_EQ(plant.reported()["in_force"], nullptr);
  for (int ends = 0; ends < 3; ++ends) plant.start();
  EXPECT_EQ(plant.retries(), 2);
}

/// A new local file no longer lets documents set links, which ends the trial of v3. v1 remains the
/// fallback of v2. Document v3 has no writable tag beyond what both local files allow.
TEST_F(RemoteEndsAfterTwoGood, ATrialThatNoLongerFitsLeavesTheWayBack) {
  const json commands = plant.local()["devices"][0]["commands"];
  plant.local()["devices"][0]["commands"] = json::object();
  json trial = plant.with_retries("v3", 9);
  trial["config"]["links"] = plant.local()["links"];
  trial["config"]["links"][0]["serial"]["path"] = "/dev/ttyUSB7";
  trial["config"]["devices"][0]["tags"].erase(2);
  EXPECT_TRUE(plant.hear(trial)) << plant.said();
  plant.local()["agent"]["remote_allow"] = {"devices"};
  plant.local()["devices"][0]["commands"] = commands;
  plant.write();
  EXPECT_TRUE(plant.hang_up());
  EXPECT_EQ(plant.reported()["state"], "rejected");
  EXPECT_EQ(plant.reported()["in_force"], "v2");
  plant.start();
  plant.start();
  EXPECT_EQ(plant.reported()["in_force"], "v1");
}

TEST_F(RemoteEndsAfterTwoGood, AnHourForgivesTheEndBefore) {
  plant.start();
  plant.pass(1h);
  plant.start();
  plant.start();
  EXPECT_EQ(plant.retries(), 8);
  plant.start();
  EXPECT_EQ(plant.retries(), 7);
}

TEST_F(RemoteEndsAfterTwoGood, AnEndAfterTheHourDoesNotCount) {
  for (int ends = 0; ends < 5; ++ends) {
    plant.pass(1h);
    plant.start();
  }
  EXPECT_EQ(plant.retries(), 8);
  EXPECT_EQ(plant.reported()["state"], "applied");
}

TEST_F(RemoteEndsAfterTwoGood, AStopDoesNotCountAndForgivesNothing) {
  for (int stops = 0; stops < 5; ++stops) {
    plant.stop();
    plant.start();
  }
  EXPECT_EQ(plant.retries(), 8);
  plant.start();
  plant.stop();
  plant.start();
  EXPECT_EQ(plant.retries(), 8);
  plant.start();
  EXPECT_EQ(plant.retries(), 7);
}

/// A machine that is switched off with its plant every evening.
TEST_F(RemoteEndsAfterTwoGood, AnEndOfTheMachineDoesNotCount) {
  for (int ends = 0; ends < 5; ++ends) {
    plant.boot();
    plant.start();
  }
  EXPECT_EQ(plant.retries(), 8);
  EXPECT_EQ(plant.reported()["state"], "applied");
}

/// The crash counts against the trial.
TEST_F(RemoteEndsTest, AnEndInATrialIsNotThatOfTheGoodOne) {
  plant.hear(plant.with_retries("v1", 7));
  plant.pass(kTrial);
  for (int retries : {8, 9}) {
    plant.hear(plant.with_retries("next", retries));
    plant.start();
    EXPECT_EQ(plant.said(),
              "rolled_back \"next\": the process ended during the trial of the config");
    EXPECT_EQ(plant.retries(), 7);
  }
}

TEST_F(RemoteEndsTest, AnEndInJudgingIsNotThatOfTheGoodOne) {
  plant.hear(plant.with_retries("v1", 7));
  plant.pass(kTrial);
  plant.end_while_judging(plant.with_retries("v2", 8));
  plant.end_while_judging(plant.with_retries("v3", 9));
  EXPECT_EQ(plant.retries(), 7);
}

TEST_F(RemoteEndsTest, AnEndInJudgingIsNotThatOfTheOneOnTrial) {
  plant.hear(plant.with_retries("v1", 7));
  plant.end_while_judging(plant.with_retries("v2", 8));
  EXPECT_EQ(plant.said(), "rolled_back \"v2\": the process ended during the check of the config");
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_EQ(plant.reported()["confirmed"], false);
  plant.pass(kTrial);
  EXPECT_EQ(plant.reported()["confirmed"], true);
}

/// The same document again, on the way back from another one.
TEST_F(RemoteEndsTest, TheSameOneIsNotTheWayBackFromItself) {
  plant.hear(plant.with_retries("v1", 7));
  plant.pass(kTrial);
  plant.hear(plant.with_retries("v2", 8));
  plant.hear(plant.with_retries("v1", 7));
  plant.pass(kTrial);
  plant.start();
  plant.start();
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.reported()["in_force"], nullptr);
}

TEST_F(RemoteEndsAfterTwoGood, WhatWasWithdrawnDoesNotComeBack) {
  plant.hear_text("");
  for (int ends = 0; ends < 3; ++ends) plant.start();
  EXPECT_EQ(plant.retries(), 2);
  EXPECT_EQ(plant.said(), "applied null");
}

TEST_F(RemoteEndsTest, OneThatAStopFindsInJudgingIsJudgedByTheNextProcess) {
  plant.stop_while_judging(plant.with_retries("v1", 7));
  EXPECT_EQ(plant.said(), "applied null");
  EXPECT_EQ(plant.remote().next_wake(), SteadyTime{});
  EXPECT_TRUE(plant.pass(0s));
  EXPECT_EQ(plant.retries(), 7);
  EXPECT_EQ(plant.said(), "applied \"v1\"");
  EXPECT_EQ(plant.reported()["confirmed"], false);
}

TEST_F(RemoteEndsTest, AStopInJudgingIsGoodForOneStart) {
  plant.stop_while_judging(plant.with_retries("v1", 7));
  plant.end_while_judging(plant.with_retries("v1", 7));
  EXPECT_EQ(plant.said(), "rolled_back \"v1\": the process ended during the check of the config");
  EXPECT_FALSE(plant.pass(0s));
}

TEST_F(RemoteEndsTest, ANewerOneTakesThePlaceOfTheOneThatWasStopped) {
  plant.stop_while_judging(plant.with_retries("v1", 7));
  EXPECT_TRUE(plant.hear(plant.with_retries("v2", 8)));
  plant.pass(0s);
  EXPECT_EQ(plant.retries(), 8);
}

/// The document would not be sent again, so it is kept, and so is the trial in progress.
TEST_F(RemoteEndsTest, AStopInJudgingKeepsTheTrialToo) {
  plant.hear(plant.with_retries("v1", 7));
  plant.stop_while_judging(plant.with_retries("v2", 8));
  EXPECT_EQ(plant.said(), "applied \"v1\"");
  EXPECT_EQ(plant.retries(), 7);
  plant.pass(0s);
  EXPECT_EQ(plant.retries(), 8);
}

TEST_F(RemoteEndsTest, AStopDoesNotUndoAWithdrawal) {
  plant.hear(plant.with_retries("v1", 7));
  plant.pass(kTrial);
  plant.remote().interrupt();
  EXPECT_FALSE(plant.hear_text(""));
  plant.stop();
  plant.start();
  EXPECT_EQ(plant.retries(), 2);
}

}  // namespace
}  // namespace fxagent
