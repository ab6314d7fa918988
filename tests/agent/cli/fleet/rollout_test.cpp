#include "agent/cli/fleet/rollout.h"

#include <gtest/gtest.h>

#include "agent/text/sha256.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using Outcome = Push::Outcome;
using Indexes = std::vector<std::size_t>;

struct RolloutTest : ::testing::Test {
  /// Makes a rollout to a, b, c, d, which are online.
  Rollout rollout(RolloutRules rules) {
    std::vector<Push> pushes;
    for (const char* name : {"a", "b", "c", "d"}) {
      Push push;
      push.agent = name;
      push.document = "x";
      push.version = "v2";
      push.hash = short_hash(push.document);
      pushes.push_back(push);
      set_online(name, true);
    }
    return {pushes, rules};
  }
  void set_online(const std::string& name, bool online) {
    fleet.take("fx/" + name + "/state",
               online ? R"({"state": "online"})" : R"({"state": "offline"})");
  }
  void answer(const std::string& name, const std::string& state, bool confirmed = false,
              const std::string& document = "x") {
    fleet.take("fx/" + name + "/config/reported",
               R"({"state": ")" + state + R"(", "errors": ["no link"], "desired_hash": ")" +
                   short_hash(document) + R"(", "confirmed": )" + (confirmed ? "true" : "false") +
                   "}");
  }
  static std::vector<Outcome> outcomes(const Rollout& rollout) {
    std::vector<Outcome> out;
    for (const Push& push : rollout.pushes()) out.push_back(push.outcome);
    return out;
  }

  Fleet fleet{"fx"};
  SteadyTime now{};
};

TEST_F(RolloutTest, EachBatchBeginsWhenAllOfTheOneBeforeHaveAccepted) {
  Rollout sent = rollout({.batch = 2});
  EXPECT_EQ(sent.advance(fleet, now), (Indexes{0, 1}));
  EXPECT_EQ(sent.deadline(), now + 30s);
  answer("b", "applied");
  EXPECT_EQ(sent.advance(fleet, now + 1s), Indexes{});
  answer("a", "applied", false, "an earlier document");
  EXPECT_EQ(sent.advance(fleet, now + 1s), Indexes{});
  answer("a", "applied");
  EXPECT_EQ(sent.advance(fleet, now + 2s), (Indexes{2, 3}));
  EXPECT_EQ(sent.deadline(), now + 32s);
  EXPECT_EQ(sent.batch(), 2U);
  EXPECT_EQ(sent.batches(), 2U);
  answer("c", "applied");
  answer("d", "applied");
  EXPECT_EQ(sent.advance(fleet, now + 3s), Indexes{});
  EXPECT_TRUE(sent.is_over());
  EXPECT_TRUE(sent.is_good());
}

TEST_F(RolloutTest, StopsAtTheFirstBatchWithARefusalAfterAllOfItHaveAnswered) {
  Rollout sent = rollout({.batch = 2});
  sent.advance(fleet, now);
  answer("a", "rejected");
  EXPECT_EQ(sent.advance(fleet, now), Indexes{});
  EXPECT_FALSE(sent.is_over()) << "b has not answered";
  answer("b", "applied");
  EXPECT_EQ(sent.advance(fleet, now), Indexes{});
  EXPECT_TRUE(sent.is_over());
  EXPECT_FALSE(sent.is_good());
  EXPECT_EQ(outcomes(sent), (std::vector{Outcome::refused, Outcome::accepted, Outcome::not_sent,
                                         Outcome::not_sent}));
  EXPECT_EQ(sent.pushes()[0].why, std::vector<std::string>{"no link"});
}

TEST_F(RolloutTest, StopsAtSilence) {
  Rollout sent = rollout({.batch = 1, .patience = 5s});
  EXPECT_EQ(sent.advance(fleet, now), Indexes{0});
  EXPECT_EQ(sent.advance(fleet, now + 4999ms), Indexes{});
  EXPECT_FALSE(sent.is_over());
  EXPECT_EQ(sent.advance(fleet, now + 5s), Indexes{});
  EXPECT_TRUE(sent.is_over());
  EXPECT_EQ(sent.pushes()[0].outcome, Outcome::silent);
  EXPECT_NE(sent.pushes()[0].why.at(0).find("remote_config"), std::string::npos);
}

TEST_F(RolloutTest, SendsNothingToAnAgentThatIsOfflineAndStops) {
  Rollout sent = rollout({.batch = 2});
  set_online("b", false);
  EXPECT_EQ(sent.advance(fleet, now), Indexes{0});
  answer("a", "applied");
  EXPECT_EQ(sent.advance(fleet, now), Indexes{});
  EXPECT_TRUE(sent.is_over());
  EXPECT_EQ(outcomes(sent), (std::vector{Outcome::accepted, Outcome::offline, Outcome::not_sent,
                                         Outcome::not_sent}));
}

TEST_F(RolloutTest, LeavesOutOfflineAgentsIfItMay) {
  Rollout sent = rollout({.batch = 1, .skip_offline = true});
  set_online("a", false);
  set_online("c", false);
  EXPECT_EQ(sent.advance(fleet, now), Indexes{});
  EXPECT_FALSE(sent.waits());
  EXPECT_EQ(sent.advance(fleet, now), Indexes{1});
  EXPECT_TRUE(sent.waits());
  answer("b", "applied");
  sent.advance(fleet, now);
  EXPECT_EQ(sent.advance(fleet, now), Indexes{3});
  answer("d", "applied");
  sent.advance(fleet, now);
  EXPECT_TRUE(sent.is_over());
  EXPECT_TRUE(sent.is_good());
}

TEST_F(RolloutTest, IsNotGoodIfAllAgentsWereLeftOut) {
  Rollout sent = rollout({.batch = 4, .skip_offline = true});
  for (const char* name : {"a", "b", "c", "d"}) set_online(name, false);
  sent.advance(fleet, now);
  sent.advance(fleet, now);
  EXPECT_TRUE(sent.is_over());
  EXPECT_FALSE(sent.is_good());
}

TEST_F(RolloutTest, WaitsForTheTrialIfAsked) {
  Rollout sent = rollout({.batch = 1, .patience = 120s, .confirmed = true});
  sent.advance(fleet, now);
  answer("a", "applied", false);
  EXPECT_EQ(sent.advance(fleet, now), Indexes{});
  answer("a", "applied", true);
  EXPECT_EQ(sent.advance(fleet, now), Indexes{1});
  answer("b", "applied", false);
  answer("b", "rolled_back");
  sent.advance(fleet, now);
  EXPECT_TRUE(sent.is_over());
  EXPECT_EQ(sent.pushes()[1].why,
            (std::vector<std::string>{"rolled back; to try it again, send it with another version",
                                      "no link"}));
}

TEST_F(RolloutTest, AConfigWhoseTrialIsNotOverInTimeIsOnTrial) {
  const auto after_the_end = [&](const auto& end) {
    Rollout sent = rollout({.batch = 3, .patience = 5s, .confirmed = true});
    sent.advance(fleet, now);
    answer("a", "applied");
    answer("b", "applied");
    set_online("b", false);
    end(sent);
    EXPECT_TRUE(sent.is_over());
    EXPECT_FALSE(sent.is_good());
    EXPECT_EQ(outcomes(sent), (std::vector{Outcome::on_trial, Outcome::on_trial, Outcome::silent,
                                           Outcome::not_sent}));
    EXPECT_EQ(sent.pushes()[1].why.at(0), "the agent went offline during the trial");
  };
  after_the_end([&](Rollout& sent) { sent.advance(fleet, now + 5s); });
  after_the_end([&](Rollout& sent) { sent.end(fleet); });
}

TEST_F(RolloutTest, StopsWhenTheBrokerRefusesTheMessage) {
  Rollout sent = rollout({.batch = 1});
  sent.advance(fleet, now);
  sent.not_accepted(0, "Not authorized");
  EXPECT_EQ(sent.advance(fleet, now), Indexes{});
  EXPECT_TRUE(sent.is_over());
  EXPECT_EQ(sent.pushes()[0].outcome, Outcome::not_allowed);
}

TEST_F(RolloutTest, AnAgentThatHasTheDocumentCountsAtOnce) {
  Rollout sent = rollout({.batch = 1});
  answer("a", "applied", true);
  EXPECT_EQ(sent.advance(fleet, now), Indexes{0}) << "so that the broker has it too";
  EXPECT_EQ(sent.advance(fleet, now), Indexes{1});
}

TEST_F(RolloutTest, ARefusalFromBeforeThePushIsNoAnswerToIt) {
  for (const char* state : {"rejected", "rolled_back"}) {
    Rollout sent = rollout({.batch = 1, .patience = 5s});
    answer("a", state);
    answer("b", state);
    answer("c", state);
    sent.advance(fleet, now);
    EXPECT_EQ(sent.advance(fleet, now + 1s), Indexes{});
    EXPECT_TRUE(sent.waits()) << state;
    answer("a", "applied");
    EXPECT_EQ(sent.advance(fleet, now + 1s), Indexes{1}) << "this time the disk was not full";
    EXPECT_EQ(sent.advance(fleet, now + 6s), Indexes{});
    EXPECT_EQ(sent.pushes()[1].outcome, Outcome::silent);
    EXPECT_EQ(sent.pushes()[1].why.at(0), "no answer; it refused the same document before");
  }
}

TEST_F(RolloutTest, TheSameRefusalAgainIsAnAnswer) {
  Rollout sent = rollout({.batch = 1});
  answer("a", "rejected");
  sent.advance(fleet, now);
  answer("a", "rejected");
  sent.advance(fleet, now);
  EXPECT_EQ(sent.pushes()[0].outcome, Outcome::refused);
}

}  // namespace
}  // namespace fxagent
