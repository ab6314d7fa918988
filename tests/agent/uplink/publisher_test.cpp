#include "agent/uplink/publisher.h"

#include <gtest/gtest.h>

#include <stop_token>
#include <thread>

#include "tests/agent/uplink/publisher_bench.h"

namespace fxagent {
namespace {

using nlohmann::json;
using test::kBase;
using test::Seqs;
using test::seqs;
using Bench = test::PublisherBench;
using namespace std::chrono_literals;

using PublisherOnlineTest = test::OnBenchOnline;
using PublisherTest = test::OnBench;

TEST_F(PublisherTest, ConnectSubscribesThenPublishesEverythingRetained) {
  bench.report(test::offline(0, "timeout"));
  const std::vector<std::string> expected{"subscribe " + kBase + "/state",
                                          "subscribe " + kBase + "/+/command",
                                          "subscribe " + kBase + "/+/state",
                                          "subscribe " + kBase + "/+/meta",
                                          kBase + "/state",
                                          kBase + "/press1/state",
                                          kBase + "/press1/meta",
                                          kBase + "/press2/meta",
                                          kBase + "/health"};
  EXPECT_EQ(bench.broker.order, expected);
  for (const Publication& p : bench.broker.taken) {
    EXPECT_EQ(p.retain, Retain::yes) << p.topic;
    EXPECT_EQ(p.qos, 1) << p.topic;
  }
  const json state = json::parse(bench.broker.on(kBase + "/state").at(0));
  EXPECT_EQ(state["state"], "online");
  EXPECT_EQ(state["boot"], "9f3c21aa");
}

TEST_F(PublisherTest, EveryRetainedTopicComesAgainAfterAReconnect) {
  bench.outbox.push(test::offline(1, "timeout"));
  bench.online();
  bench.lose_connection();
  bench.advance(2s);
  EXPECT_EQ(bench.broker.on(kBase + "/state").size(), 1U);
  EXPECT_EQ(bench.broker.on(kBase + "/press1/meta").size(), 1U);
  EXPECT_EQ(bench.broker.on(kBase + "/health").size(), 1U);
  ASSERT_EQ(bench.broker.on(kBase + "/press2/state").size(), 1U);
  EXPECT_EQ(json::parse(bench.broker.on(kBase + "/press2/state")[0])["reason"], "timeout");
}

TEST_F(PublisherOnlineTest, AcknowledgementWakesNobodyWhoDoesNotWaitForIt) {
  bench.broker.acknowledges = false;
  bench.outbox.push(test::sample(1));
  const SteadyTime wake = bench.step();
  EXPECT_EQ(bench.broker.open(), 1U);
  EXPECT_FALSE(bench.broker.acknowledgements_awaited);
  EXPECT_LE(wake, bench.now + 50ms);  // written down soon all the same
  bench.outbox.push(test::succeeded("b7e1"));
  bench.step();
  EXPECT_TRUE(bench.broker.acknowledgements_awaited) << "a result is marked as told";
  bench.acknowledge_all();
  EXPECT_FALSE(bench.broker.acknowledgements_awaited);
  for (std::uint64_t seq = 2; seq < 30; ++seq) bench.outbox.push(test::sample(seq));
  bench.step();
  EXPECT_TRUE(bench.broker.acknowledgements_awaited) << "the window is full";
}

TEST_F(PublisherTest, SamplesGatherForAHundredthOfTheirIntervalWhileTheyStream) {
  bench.config.devices[0].groups[0].interval = 200ms;
  bench.config.devices[0].groups[1].interval = 0ms;
  bench.online();
  const auto patience = [&](std::uint64_t seq, std::uint32_t device, std::uint32_t group) {
    bench.outbox.push(test::sample(seq, device, group));
    bench.step();
    return bench.publisher->gather_until() - bench.now;
  };
  EXPECT_EQ(patience(1, 0, 0), 0ms) << "one alone";
  bench.now += 1ms;
  EXPECT_EQ(patience(2, 0, 0), 2ms);
  bench.now += 1ms;
  EXPECT_EQ(patience(1, 1, 0), 5ms) << "of a second it would be ten";
  bench.now += 1ms;
  EXPECT_EQ(patience(3, 0, 1), 0ms) << "as fast as the line allows";
  bench.now += 20ms;
  EXPECT_EQ(patience(4, 0, 0), 0ms) << "they stream no more";
}

TEST_F(PublisherTest, SampleGoesOutLiveAtTheDataQos) {
  bench.config.mqtt.qos = 0;
  bench.online();
  bench.report(test::sample(7, 1, 1));
  ASSERT_EQ(bench.broker.taken.size(), 1U);
  const Publication& live = bench.broker.taken[0];
  EXPECT_EQ(live.topic, kBase + "/press2/data/slow");
  EXPECT_EQ(live.qos, 0);
  EXPECT_EQ(live.retain, Retain::no);
  EXPECT_EQ(json::parse(live.payload)["meta"],
            json::parse(fxagent::json::device_meta(bench.config.devices[1]).text)["hash"]);
  EXPECT_EQ(bench.made().samples().acknowledged, 1U);
}

TEST_F(PublisherOnlineTest, WindowIsKeptAndResultsStillFindRoom) {
  bench.broker.acknowledges = false;
  bench.take_samples(1, 100);
  EXPECT_EQ(bench.broker.open(), 18U);
  bench.report(test::succeeded("a"));
  EXPECT_EQ(bench.broker.on(kBase + "/press1/result").size(), 1U);
  for (const char* id : {"b", "c", "d"}) bench.outbox.push(test::succeeded(id));
  bench.settle();
  EXPECT_EQ(bench.broker.open(), 20U);
  EXPECT_EQ(bench.broker.most_open, 20U);
}

TEST_F(PublisherTest, SmallerReceiveMaximumIsObeyed) {
  bench.broker.receive_maximum = 3;
  bench.broker.acknowledges = false;
  bench.take_samples(1, 10);
  for (int i = 0; i < 50; ++i) {
    EXPECT_LE(bench.broker.open(), 3U);
    if (bench.broker.open() > 0) bench.broker.acknowledge_next();
    bench.settle();
  }
  EXPECT_EQ(bench.broker.most_open, 3U);
  EXPECT_EQ(bench.made().samples().acknowledged, 10U);
}

TEST_F(PublisherOnlineTest, UnacknowledgedSamplesComeAgainAsHistoryBesideLiveOnes) {
  bench.broker.acknowledges = false;
  bench.take_samples(1, 3);
  bench.broker.lose();
  bench.take_samples(4);
  EXPECT_EQ(bench.made().samples().stored, 4U);
  bench.broker.acknowledges = true;
  bench.broker.log.clear();
  bench.now += 2s;
  bench.outbox.push(test::sample(5));  // before the reconnect: becomes history too
  bench.settle();
  bench.take_samples(6);
  EXPECT_EQ(bench.history(), (Seqs{1, 2, 3, 4, 5}));
  EXPECT_EQ(bench.live(), (Seqs{6}));
  const json history = json::parse(bench.broker.on(kBase + "/press1/data/fast/history").at(0));
  EXPECT_EQ(history["history"], true);
  EXPECT_TRUE(history["rows"][0].contains("boot") && history["rows"][0].contains("values"));
  const SampleCounts samples = bench.made().samples();
  EXPECT_EQ(samples.acknowledged, 6U);
  EXPECT_EQ(samples.stored, 0U);
  EXPECT_EQ(samples.published, 9U);  // three of them twice
}

TEST_F(PublisherTest, RowsLeaveMemoryOnlyAfterTheirAcknowledgement) {
  bench.broker.reachable = false;
  bench.take_samples(1, 3);
  bench.broker.reachable = true;
  bench.advance(40s);
  bench.advance(20s);
  EXPECT_EQ(bench.made().samples().stored, 0U);
  bench.broker.lose();
  bench.take_samples(4);
  bench.broker.acknowledges = false;
  bench.advance(40s);
  EXPECT_EQ(bench.history(), (Seqs{1, 2, 3, 4}));
  EXPECT_EQ(bench.made().samples().stored, 1U);
  bench.acknowledge_all();
  EXPECT_EQ(bench.made().samples().stored, 0U);
}

TEST_F(PublisherTest, HistoryMessagesStayBelowTheirLimit) {
  bench.broker.reachable = false;
  bench.take_samples(1, 999);
  bench.broker.reachable = true;
  bench.advance(40s);
  const auto messages = bench.broker.on(kBase + "/press1/data/fast/history");
  EXPECT_GT(messages.size(), 1U);
  for (const std::string& message : messages) EXPECT_LE(message.size(), 65536U);
  EXPECT_EQ(seqs(messages).size(), 999U);
}

TEST_F(PublisherOnlineTest, SampleThatFindsNoRoomForASecondBecomesHistory) {
  bench.broker.acknowledges = false;
  bench.take_samples(1, 20);
  EXPECT_EQ(bench.made().samples().queued, 2U);
  bench.advance(1s);
  EXPECT_EQ(bench.made().samples().queued, 0U);
  EXPECT_EQ(bench.made().samples().stored, 2U);
  bench.broker.acknowledges = true;
  bench.acknowledge_all();
  EXPECT_EQ(bench.history(), (Seqs{19, 20}));
}

TEST_F(PublisherTest, FullBacklogDropsTheOldestAndCountsThem) {
  bench.settings.backlog_bytes = 3000;
  bench.broker.reachable = false;
  for (std::uint64_t seq = 1; seq <= 50; ++seq) bench.outbox.push(test::sample(seq, 1));
  bench.settle();
  const std::uint64_t dropped = bench.made().samples().dropped;
  EXPECT_GT(dropped, 30U);
  bench.broker.reachable = true;
  bench.advance(40s);
  const auto arrived = bench.history("press2");
  ASSERT_EQ(arrived.size(), 50 - dropped);
  EXPECT_EQ(arrived.front(), dropped + 1);
  const json health = bench.last("/health");
  EXPECT_EQ(health["devices"]["press2"]["dropped"], dropped);
  EXPECT_EQ(health["samples"]["dropped"], dropped);
}

// ---- with a store on disk ----------------------------------------------------------------------

TEST_F(PublisherOnlineTest, BrokerThatAcknowledgesNothingForHalfAMinuteIsLeft) {
  bench.advance(2min);  // nothing in flight: no wait
  EXPECT_EQ(bench.broker.connects.size(), 1U);
  bench.broker.acknowledges = false;
  bench.take_samples(1);
  bench.advance(29s);
  EXPECT_EQ(bench.broker.connects.size(), 1U);
  EXPECT_LE(bench.step(), bench.now + 1s);
  bench.broker.acknowledges = true;
  bench.advance(1s);
  bench.advance(2s);
  EXPECT_EQ(bench.broker.connects.size(), 2U);
  EXPECT_EQ(bench.history(), Seqs{1});
}

TEST_F(PublisherTest, RetainedTopicsOfUnknownDevicesAreCleared) {
  bench.settle();
  bench.broker.taken.clear();
  const auto retained = [&](const std::string& topic, const std::string& payload) {
    bench.broker.send(test::message_on(topic, payload, true));
  };
  retained(kBase + "/press9/state", "{}");
  retained(kBase + "/press9/meta", "{}");
  retained(kBase + "/press8/meta", "");  // the echo of clearing it
  retained(kBase + "/press1/state", "{}");
  bench.settle();
  ASSERT_EQ(bench.broker.taken.size(), 2U);
  for (const Publication& p : bench.broker.taken) {
    EXPECT_TRUE(p.topic == kBase + "/press9/state" || p.topic == kBase + "/press9/meta");
    EXPECT_EQ(p.payload, "");
    EXPECT_EQ(p.retain, Retain::yes);
  }
  bench.advance(10s);
  EXPECT_EQ(bench.broker.filters, (std::set<std::string>{kBase + "/state", kBase + "/+/command",
                                                         kBase + "/+/state", kBase + "/+/meta"}));
  bench.broker.taken.clear();
  retained(kBase + "/press7/state", "{}");
  bench.settle();
  EXPECT_TRUE(bench.broker.taken.empty()) << "only what was found when subscribing is cleared";
}

TEST_F(PublisherTest, ServersAreTriedFromTheTopWithGrowingPauses) {
  bench.broker.reachable = false;
  bench.settle();
  EXPECT_EQ(bench.broker.connects, (std::vector<std::size_t>{0, 1}));
  SteadyTime::duration last{};
  for (int round = 2; round < 9; ++round) {
    const SteadyTime begin = bench.now;
    while (bench.broker.connects.size() < static_cast<std::size_t>(2 * round))
      bench.advance(bench.step() - bench.now);
    const SteadyTime::duration pause = bench.now - begin;
    EXPECT_GE(pause, 1s);
    EXPECT_LE(pause, 38s);  // 30 s plus a quarter
    if (round < 6) {
      EXPECT_GT(pause, last);
    }
    last = pause;
    EXPECT_EQ(bench.broker.connects.back(), 1U);
  }
}

TEST_F(PublisherTest, StaysOnItsServerUntilThatFailsAndThenTriesItLast) {
  bench.broker.reachable = false;
  bench.settle();
  bench.broker.reachable = true;
  bench.advance(2s);
  ASSERT_TRUE(bench.broker.up());
  bench.advance(1h);
  const std::size_t connects = bench.broker.connects.size();
  bench.lose_connection();
  bench.advance(2s);
  ASSERT_EQ(bench.broker.connects.size(), connects + 1);
  EXPECT_EQ(bench.broker.connects.back(), 1U);
  bench.advance(1h);
  EXPECT_EQ(bench.broker.connects.size(), connects + 1);
  bench.lose_connection();
  bench.advance(2s);
  ASSERT_EQ(bench.broker.connects.size(), connects + 2);
  EXPECT_EQ(bench.broker.connects.back(), 0U);
}

TEST_F(PublisherTest, ServerThatDropsUsAtOnceIsNotTriedForEver) {
  bench.settle();
  bench.lose_connection();
  bench.advance(1s);
  EXPECT_EQ(bench.broker.connects, (std::vector<std::size_t>{0, 1}));
}

TEST_F(PublisherTest, LibraryThatNeverAnswersIsGivenUp) {
  bench.broker.reachable = false;
  bench.broker.answers = false;
  bench.step();
  EXPECT_EQ(bench.broker.connects.size(), 1U);
  bench.advance(30s);
  EXPECT_EQ(bench.broker.connects.size(), 2U);
}

TEST_F(PublisherOnlineTest, SampleThatNoRepeatCanCureIsDroppedAndCounted) {
  bench.broker.acknowledges = false;
  for (const int code : {0x90, 0x95, 0x99}) {
    bench.report(test::sample(static_cast<std::uint64_t>(code)));
    bench.broker.refuse_next(code);
    bench.settle();
  }
  EXPECT_EQ(bench.made().samples().dropped, 3U);
  EXPECT_EQ(bench.broker.open(), 0U);
}

TEST_F(PublisherOnlineTest, RefusedDeviceWaitsAndItsNeighbourDoesNot) {
  bench.broker.acknowledges = false;
  for (const int code : {0x87, 0x97}) {
    bench.broker.log.clear();
    bench.report(test::sample(1, 0));
    bench.broker.refuse_next(code);
    bench.settle();
    EXPECT_EQ(bench.made().samples().dropped, 0U);
    bench.outbox.push(test::sample(2, 0));
    bench.outbox.push(test::sample(3, 1));
    bench.settle();
    EXPECT_EQ(bench.live("press2"), Seqs{3});
    EXPECT_TRUE(bench.broker.on(kBase + "/press1/data/fast/history").empty());
    bench.broker.acknowledge_all();
    bench.advance(2s);
    EXPECT_EQ(bench.history(), (Seqs{1, 2}));
    bench.acknowledge_all();
  }
  EXPECT_EQ(bench.made().samples().acknowledged, 6U);
}

TEST_F(PublisherOnlineTest, HealthNamesTheCodeOfARefusalUntilItIsOver) {
  bench.broker.acknowledges = false;
  bench.report(test::sample(1, 0));
  bench.broker.refuse_next(0x97);
  bench.settle();
  const auto refused = [&] {
    bench.advance(60s);
    const json health = bench.last("/health");
    EXPECT_EQ(health["devices"]["press2"]["refused"], nullptr);
    return health["devices"]["press1"]["refused"];
  };
  EXPECT_EQ(refused(), "0x97");
  bench.broker.acknowledges = true;
  bench.acknowledge_all();
  EXPECT_EQ(refused(), nullptr);
}

TEST_F(PublisherTest, HistoryThatIsTooLargeIsCutInsteadOfDropped) {
  bench.broker.reachable = false;
  bench.broker.maximum_packet = 2000;
  bench.take_samples(1, 100);
  bench.broker.reachable = true;
  bench.advance(40s);
  EXPECT_EQ(bench.made().samples().acknowledged, 100U);
  EXPECT_EQ(bench.made().samples().dropped, 0U);
  for (const Publication& p : bench.broker.taken) EXPECT_LE(p.payload.size(), 2000U);
}

TEST_F(PublisherOnlineTest, RefusedStateComesAgainWithItsNewestValue) {
  bench.broker.acknowledges = false;
  bench.report(test::offline(0, "timeout"));
  bench.broker.refuse_next(0x97);
  bench.settle();
  bench.outbox.push(test::offline(0, "link_down"));
  bench.advance(2s);
  const auto states = bench.broker.on(kBase + "/press1/state");
  EXPECT_EQ(json::parse(states.back())["reason"], "link_down");
  bench.broker.acknowledges = true;
  bench.broker.acknowledge_all();
  bench.advance(40s);
  EXPECT_EQ(bench.broker.on(kBase + "/press1/state").size(), states.size());
}

TEST_F(PublisherOnlineTest, HealthComesEveryMinuteAndBalances) {
  bench.outbox.push(test::sample(1));
  bench.outbox.push(test::sample(2));
  bench.outbox.push(test::counted(5, 3));
  bench.settle();
  bench.advance(60s);
  bench.advance(60s);
  const auto health = bench.broker.on(kBase + "/health");
  ASSERT_EQ(health.size(), 2U);
  const json samples = json::parse(health[0])["samples"];
  EXPECT_EQ(samples["collected"], 5);
  EXPECT_EQ(samples["suppressed"], 3);
  EXPECT_EQ(samples["acknowledged"], 2);
  EXPECT_EQ(json::parse(health[0])["devices"]["press1"]["polls"], 9);
  EXPECT_EQ(json::parse(health[1])["uptime_s"], 140);
}

TEST_F(PublisherOnlineTest, StopPublishesWhatWaitsThenSaysStopped) {
  bench.outbox.push(test::sample(1));
  bench.outbox.push(test::succeeded("a"));
  bench.made().stop(bench.now);
  bench.settle();
  EXPECT_TRUE(bench.made().finished());
  EXPECT_EQ(bench.broker.disconnects, 1);
  ASSERT_EQ(bench.broker.taken.size(), 3U);
  EXPECT_EQ(bench.broker.taken[0].topic, kBase + "/press1/data/fast");
  EXPECT_EQ(bench.broker.taken[1].topic, kBase + "/press1/result");
  EXPECT_EQ(bench.broker.taken[2].topic, kBase + "/state");
  const json state = json::parse(bench.broker.taken[2].payload);
  EXPECT_EQ(state["state"], "offline");
  EXPECT_EQ(state["reason"], "stopped");
  EXPECT_TRUE(state["since"].is_number());
}

TEST_F(PublisherOnlineTest, StopEndsInTimeWithABrokerThatDoesNotAnswer) {
  bench.broker.acknowledges = false;
  bench.outbox.push(test::sample(1));
  bench.made().stop(bench.now);
  const SteadyTime begin = bench.now;
  for (int i = 0; i < 100; ++i) {
    const SteadyTime wake = bench.step();
    if (bench.made().finished()) break;
    bench.now = wake;
  }
  EXPECT_TRUE(bench.made().finished());
  EXPECT_LE(bench.now - begin, 5s);
  EXPECT_EQ(json::parse(bench.broker.log.back().payload)["reason"], "stopped");
}

TEST_F(PublisherTest, StopWithoutABrokerEndsAtOnce) {
  bench.broker.reachable = false;
  bench.settle();
  bench.made().stop(bench.now);
  bench.settle();
  EXPECT_TRUE(bench.made().finished());
}

TEST_F(PublisherTest, StopDoesNotSpinWhileAServerIsSilent) {
  bench.broker.reachable = bench.broker.answers = false;
  bench.settle();
  bench.now += 9s;  // the attempt ends 1 s later
  bench.stop_without_spinning(20);
}

TEST_F(PublisherTest, ConnectionMadeDuringAStopSubscribesToNothingAndSaysSo) {
  bench.broker.reachable = bench.broker.answers = false;
  bench.settle();
  bench.made().stop(bench.now);
  bench.broker.reachable = true;
  bench.broker.connect(0, kReceiveMaximum);  // the attempt succeeds
  bench.stop_without_spinning(10);
  EXPECT_TRUE(bench.broker.filters.empty());
  const auto states = bench.broker.on(kBase + "/state");
  ASSERT_EQ(states.size(), 2U);
  const json online = json::parse(states[0]);
  EXPECT_EQ(online["state"], "online");
  EXPECT_EQ(online["commands"], false);
  EXPECT_EQ(online["reason"], "the agent is stopping");
  EXPECT_EQ(json::parse(states[1])["reason"], "stopped");
}

TEST_F(PublisherTest, ThreadEndsAfterACleanStop) {
  bench.outbox.push(test::sample(1));
  Publisher& publisher = bench.made();
  std::stop_source stop;
  std::thread thread([&] { run_uplink(publisher, bench.outbox, stop.get_token()); });
  stop.request_stop();
  thread.join();
  EXPECT_TRUE(publisher.finished());
}

}  // namespace
}  // namespace fxagent
