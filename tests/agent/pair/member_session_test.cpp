#include "agent/pair/member_session.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>

#include "tests/agent/uplink/fake_broker.h"

namespace fxagent::test {
namespace {

using namespace std::chrono_literals;

/// A session with two servers, and the time, which steps() passes.
struct MemberSessionTest : ::testing::Test {
  void steps(BootTime until) {
    for (; now < until; now += 100ms) {
      session.keep(now);
      session.take_events(now, [this](const BrokerEvent& event) { events.push_back(event); });
    }
  }

  PairPeers peers{{"a", "boot", 1s}};
  FakeBroker* broker = new FakeBroker;  ///< of the session
  MemberSession session{std::unique_ptr<Broker>(broker), 2, "fx/edge", peers};
  BootTime now{1h};
  std::vector<BrokerEvent> events;  ///< as passed on
};

TEST_F(MemberSessionTest, EachFailedAttemptIsFollowedByTheNextServer) {
  broker->reachable = false;
  steps(now + 1200ms);
  EXPECT_EQ(broker->connects, (std::vector<std::size_t>{0, 1, 0}));
  broker->reachable = true;
  steps(now + 1s);
  EXPECT_EQ(session.server(), 1U);
  EXPECT_TRUE(session.is_up());
  EXPECT_TRUE(peers.joined_at());
}

TEST_F(MemberSessionTest, EqualFailuresOfItsServersAreLoggedOnceUntilItWasConnected) {
  broker->reachable = false;
  const auto lines = [this] {
    testing::internal::CaptureStderr();
    steps(now + 3s);
    const std::string log = testing::internal::GetCapturedStderr();
    return std::ranges::count(log, '\n');
  };
  EXPECT_EQ(lines(), 1);
  EXPECT_EQ(lines(), 0);
  broker->reachable = true;
  steps(now + 1s);
  broker->reachable = false;
  broker->lose(0);
  EXPECT_EQ(lines(), 1);
}

TEST_F(MemberSessionTest, SessionThatIsTakenOverAgainAndAgainPausesLonger) {
  steps(now + 1s);
  for (const BootTime pause : {1s, 2s, 4s, 8s, 16s, 32s, 32s}) {
    const std::size_t before = broker->connects.size();
    broker->lose(kSessionTakenOver);
    steps(now + 100ms);
    EXPECT_FALSE(session.is_up());
    EXPECT_FALSE(peers.joined_at());
    steps(now + pause - 100ms);
    EXPECT_EQ(broker->connects.size(), before) << pause.count();
    steps(now + 200ms);
    EXPECT_EQ(broker->connects.size(), before + 1) << pause.count();
  }
}

TEST_F(MemberSessionTest, ResultsAreSubscribedToFirstAndARefusedSubscriptionAgain) {
  broker->session_present = true;
  broker->refusal = "Not authorized";
  steps(now + 200ms);
  EXPECT_EQ(broker->order.front(), "subscribe fx/edge/+/result");
  ASSERT_EQ(broker->order.size(), 4U);
  EXPECT_FALSE(session.heard_all());
  EXPECT_FALSE(peers.joined_at());
  broker->refusal.clear();
  steps(now + 1200ms);
  EXPECT_EQ(broker->order.size(), 8U);
  EXPECT_TRUE(peers.joined_at());
}

TEST_F(MemberSessionTest, ASubscriptionWithoutAnAnswerIsRepeated) {
  broker->confirms = false;
  steps(now + 4s);
  EXPECT_EQ(broker->order.size(), 4U);
  broker->confirms = true;
  steps(now + 2s);
  EXPECT_EQ(broker->order.size(), 8U);
  EXPECT_TRUE(peers.joined_at());
  steps(now + 2min);
  EXPECT_EQ(broker->order.size(), 8U);
}

TEST_F(MemberSessionTest, AllIsHeardWhileTheBrokerKeepsTheSession) {
  broker->session_present = true;
  steps(now + 200ms);
  EXPECT_TRUE(session.heard_all());
  broker->session_present = false;
  broker->lose(0);
  steps(now + 1s);
  EXPECT_FALSE(session.heard_all());
}

TEST_F(MemberSessionTest, EventsArePassedOn) {
  steps(now + 200ms);
  broker->send(Message{});
  steps(now + 100ms);
  EXPECT_TRUE(std::holds_alternative<Connected>(events.front()));
  EXPECT_TRUE(std::holds_alternative<Message>(events.back()));
}

}  // namespace
}  // namespace fxagent::test
