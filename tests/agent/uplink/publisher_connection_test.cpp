// How the publisher detects a lost connection, reconnects, and restores its subscription to
// commands.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/agent/uplink/publisher_bench.h"

namespace fxagent {
namespace {

using nlohmann::json;
using test::kBase;
using test::Seqs;
using Bench = test::PublisherBench;
using namespace std::chrono_literals;

const std::string kCommands = "subscribe " + kBase + "/+/command";

/// Returns the time until the next attempt to connect.
SteadyTime::duration until_next_connect(Bench& bench) {
  const std::size_t connects = bench.broker.connects.size();
  const SteadyTime begin = bench.now;
  for (int i = 0; i < 5000 && bench.broker.connects.size() == connects; ++i) {
    bench.now = std::max(bench.step(), bench.now + 1ms);
    bench.step();
  }
  EXPECT_EQ(bench.broker.connects.size(), connects + 1);
  return bench.now - begin;
}

// ---- losses -------------------------------------------------------------------------------------

using PublisherConnectionOnlineTest = test::OnBenchOnline;
using PublisherConnectionTest = test::OnBench;

TEST_F(PublisherConnectionOnlineTest, GroupsWithoutAnIntervalSlowDownWhileTheBrokerIsAway) {
  EXPECT_FALSE(bench.outbox.is_backed_up());
  bench.broker.vanish();
  bench.lose_connection();
  EXPECT_TRUE(bench.outbox.is_backed_up());
  bench.advance(2s);
  ASSERT_TRUE(bench.broker.up());
  EXPECT_FALSE(bench.outbox.is_backed_up());
}

TEST_F(PublisherConnectionOnlineTest, PublishThatFindsNoConnectionIsALoss) {
  bench.broker.vanish();
  bench.broker.believes = true;
  bench.take_samples(1);
  bench.advance(2s);
  EXPECT_EQ(bench.broker.connects.size(), 2U);
  EXPECT_EQ(bench.history(), Seqs{1});
}

TEST_F(PublisherConnectionOnlineTest, ConnectionThatTheLibraryForgotToReportIsFoundGone) {
  bench.broker.vanish();
  bench.broker.finds_out = false;
  bench.advance(200ms);
  EXPECT_EQ(bench.broker.connects.size(), 1U) << "its Lost may be on its way";
  EXPECT_LE(bench.step(), bench.now + 1s);
  bench.advance(1s);
  bench.advance(2s);
  EXPECT_EQ(bench.broker.connects.size(), 2U);
}

TEST_F(PublisherConnectionOnlineTest, LibraryIsNotAskedAtEachStepWhetherItIsConnected) {
  bench.broker.checks = 0;
  const SteadyTime end = bench.now + 1s;
  for (std::uint64_t seq = 1; bench.now < end; bench.now += 1ms) {
    bench.outbox.push(test::sample(seq++));
    bench.step();
  }
  EXPECT_GT(bench.broker.checks, 5);
  EXPECT_LE(bench.broker.checks, 11);
}

TEST_F(PublisherConnectionOnlineTest, ConnectionThatDiesWithoutAWordIsGivenUpWithin90Seconds) {
  bench.broker.vanish();
  bench.broker.finds_out = false;
  bench.broker.believes = true;
  EXPECT_LE(until_next_connect(bench), 92s) << "health after 60 s, no answer for 30 s";
  EXPECT_TRUE(bench.broker.left_with_will) << "a broker that wakes up says that the agent is gone";
}

TEST_F(PublisherConnectionOnlineTest, FailedPublishesAreNoSignOfLife) {
  bench.broker.fails = true;
  std::uint64_t seq = 0;
  const auto fail_for = [&](SteadyTime::duration time) {
    for (const SteadyTime end = bench.now + time; bench.now < end; bench.now += 200ms) {
      bench.outbox.push(test::sample(++seq));
      bench.step();
    }
  };
  fail_for(29s);
  EXPECT_EQ(bench.broker.connects.size(), 1U);
  fail_for(4s);
  EXPECT_EQ(bench.broker.connects.size(), 2U);
}

TEST_F(PublisherConnectionOnlineTest, RefusalsByTheBrokerAreASignOfLife) {
  bench.broker.acknowledges = false;
  for (std::uint64_t seq = 1; seq <= 100; ++seq) {
    bench.report(test::sample(seq, seq % 2));
    while (bench.broker.open() > 0) bench.broker.refuse_next(0x87);
    bench.advance(1s);
  }
  EXPECT_EQ(bench.broker.connects.size(), 1U);
}

TEST_F(PublisherConnectionTest, MessagesOfQos0DoNotHideABrokerThatAcknowledgesNothing) {
  bench.config.mqtt.qos = 0;
  bench.online();
  bench.broker.acknowledges = false;
  bench.outbox.push(test::offline(0, "timeout"));  // QoS 1
  bench.settle();
  ASSERT_EQ(bench.broker.open(), 1U);
  bench.broker.acknowledges_qos0 = true;
  for (std::uint64_t seq = 1; seq <= 160; ++seq) {
    bench.outbox.push(test::sample(seq));
    bench.step();
    bench.now += 200ms;
  }
  EXPECT_EQ(bench.broker.connects.size(), 2U);
}

TEST_F(PublisherConnectionTest, ServerThatDoesNotAnswerIsLeftForTheNextOne) {
  bench.broker.reachable = false;
  bench.broker.answers = false;
  bench.step();
  EXPECT_LE(until_next_connect(bench), 3100ms);
  EXPECT_EQ(bench.broker.connects, (std::vector<std::size_t>{0, 1}));
}

TEST_F(PublisherConnectionTest, LossInTheMiddleOfConnectingIsAnAttemptThatFailed) {
  bench.config.mqtt.servers = {"mqtt://one:1883"};
  bench.broker.reachable = false;
  bench.broker.answers = false;
  bench.step();
  bench.broker.lose();
  bench.step();
  bench.broker.reachable = true;
  EXPECT_LE(until_next_connect(bench), 2s) << "not the 30 s of a library that never answers";
}

TEST_F(PublisherConnectionTest, EachFailureOfTwoServersIsLoggedOnceUntilItChanges) {
  bench.config.mqtt.servers = {"mqtt://one:1883", "mqtt://two:1883"};
  bench.broker.reachable = false;
  const auto lines = [this](bool one_answers = false) {
    testing::internal::CaptureStderr();
    for (int attempt = 0; attempt < 6; ++attempt) {
      bench.broker.answers = one_answers || attempt % 2 == 0;
      until_next_connect(bench);
    }
    const std::string log = testing::internal::GetCapturedStderr();
    return std::ranges::count(log, '\n');
  };
  bench.step();
  EXPECT_EQ(lines(), 2) << "connection refused, no answer";
  EXPECT_EQ(lines(), 0);
  EXPECT_EQ(lines(true), 0) << "both servers refuse, which is known of one";
  EXPECT_EQ(lines(), 1) << "no answer any more";
  bench.broker.reachable = true;
  until_next_connect(bench);
  bench.broker.reachable = false;
  bench.lose_connection();
  EXPECT_EQ(lines(), 2);
}

// ---- the next attempt ---------------------------------------------------------------------------

TEST_F(PublisherConnectionTest, BrokerThatIsBackWithinMinutesIsMetWithinFiveSeconds) {
  bench.config.mqtt.servers = {"mqtt://one:1883"};
  bench.online();
  bench.broker.reachable = false;
  bench.lose_connection();
  for (const SteadyTime end = bench.now + 4min; bench.now < end;)
    EXPECT_LE(until_next_connect(bench), 5s);
  bench.now += 2min;
  SteadyTime::duration longest{};
  for (int i = 0; i < 5; ++i) longest = std::max(longest, until_next_connect(bench));
  EXPECT_GE(longest, 30s) << "a long outage is no hurry";
}

TEST_F(PublisherConnectionTest, BrokerThatThrowsUsOffIsMetEverMoreSlowly) {
  bench.config.mqtt.servers = {"mqtt://one:1883"};
  bench.online();
  // Another agent with this id does the same, so each connection lasts as long as its pause.
  SteadyTime::duration pause{};
  for (int thrown = 0; thrown < 12; ++thrown) {
    bench.lose_connection();
    const SteadyTime::duration next = until_next_connect(bench);
    // The first connection was stable: its agents spread over a second.
    EXPECT_GE(next, thrown == 0 ? 250ms : std::min<SteadyTime::duration>(60s, 1s * (1 << thrown)))
        << thrown;
    EXPECT_LE(next, std::min<SteadyTime::duration>(75s, 1250ms * (1 << thrown)) + 10ms) << thrown;
    pause = next;
    bench.settle();
    bench.advance(pause);
  }
  bench.advance(150s);  // the other agent has stopped
  bench.lose_connection();
  EXPECT_LE(until_next_connect(bench), 1300ms);
}

// ---- the subscription to commands ---------------------------------------------------------------

TEST_F(PublisherConnectionTest, OnlineIsSaidOnceTheSubscriptionIsGranted) {
  bench.broker.confirms = false;
  bench.settle();
  EXPECT_TRUE(bench.broker.on(kBase + "/state").empty());
  bench.broker.answer_subscription(kBase + "/+/command", "");
  bench.settle();
  EXPECT_FALSE(bench.last("/state").contains("commands")) << bench.last("/state");
  EXPECT_FALSE(bench.last("/state").contains("reason")) << bench.last("/state");
  bench.advance(1h);
  EXPECT_EQ(std::count(bench.broker.order.begin(), bench.broker.order.end(), kCommands), 1);
}

TEST(PublisherConnection, RefusedSubscriptionIsInTheStateAndAskedForAgain) {
  Bench bench;
  bench.broker.refusal = "Not authorized";
  bench.settle();
  EXPECT_EQ(bench.last("/state")["state"], "online");
  EXPECT_EQ(bench.last("/state")["commands"], false);
  EXPECT_EQ(bench.last("/state")["reason"], "Not authorized");
  std::vector<SteadyTime> asked;
  const auto asks = [&bench] {
    return std::count(bench.broker.order.begin(), bench.broker.order.end(), kCommands);
  };
  for (const SteadyTime end = bench.now + 10min; bench.now < end;) {
    const auto before = asks();
    bench.now = std::max(bench.step(), bench.now + 1ms);
    bench.step();
    if (asks() > before) asked.push_back(bench.now);
  }
  ASSERT_GE(asked.size(), 10U);
  EXPECT_LE(asked.size(), 20U);
  for (std::size_t i = 1; i < asked.size(); ++i) {
    EXPECT_GE(asked[i] - asked[i - 1], 1s);
    EXPECT_LE(asked[i] - asked[i - 1], 76s);
  }
  EXPECT_LE(asked[1] - asked[0], 3s);
  EXPECT_EQ(bench.broker.on(kBase + "/state").size(), 1U) << "the same is not said again";
  EXPECT_EQ(bench.broker.connects.size(), 1U);
  bench.broker.refusal.clear();
  bench.advance(76s);
  EXPECT_FALSE(bench.last("/state").contains("commands"));
  EXPECT_FALSE(bench.last("/state").contains("reason"));
  EXPECT_EQ(bench.broker.on(kBase + "/state").size(), 2U);
  const auto asks_at_last = asks();
  bench.advance(1h);
  EXPECT_EQ(asks(), asks_at_last);
}

TEST_F(PublisherConnectionTest, UnansweredSubscriptionIsInTheStateAfterASecond) {
  bench.broker.confirms = false;
  bench.take_samples(1);
  EXPECT_LE(bench.step(), bench.now + 1s);
  bench.advance(1s);
  EXPECT_EQ(bench.last("/state")["commands"], false);
  EXPECT_EQ(bench.last("/state")["reason"], "the broker does not confirm the subscription");
  EXPECT_EQ(bench.made().samples().acknowledged, 1U) << "samples do not wait for it";
  bench.advance(5s);
  EXPECT_EQ(std::count(bench.broker.order.begin(), bench.broker.order.end(), kCommands), 2);
  bench.broker.answer_subscription(kBase + "/+/command", "");
  bench.settle();
  EXPECT_FALSE(bench.last("/state").contains("commands"));
}

TEST_F(PublisherConnectionTest, DeafnessEndsWithItsConnection) {
  bench.broker.refusal = "Not authorized";
  bench.online();
  bench.broker.refusal.clear();
  bench.lose_connection();
  bench.advance(3s);
  ASSERT_EQ(bench.broker.connects.size(), 2U);
  EXPECT_EQ(bench.last("/state")["state"], "online");
  EXPECT_FALSE(bench.last("/state").contains("commands"));
}

TEST_F(PublisherConnectionTest, StopDoesNotWaitForASuback) {
  bench.broker.confirms = false;
  bench.step();
  bench.made().stop(bench.now);
  bench.settle();
  EXPECT_EQ(bench.last("/state")["reason"], "stopped");
  EXPECT_TRUE(bench.made().finished());
}

}  // namespace
}  // namespace fxagent
