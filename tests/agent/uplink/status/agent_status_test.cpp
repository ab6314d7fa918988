// The agent's status as a reader of the status board sees it.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <stop_token>
#include <thread>

#include "tests/agent/uplink/publisher_bench.h"

namespace fxagent {
namespace {

using nlohmann::json;
using test::kBase;
using namespace std::chrono_literals;

using Status = std::shared_ptr<const AgentStatus>;
using Kinds = std::vector<std::string>;
using Values = std::map<std::string, LastValue, std::less<>>;

struct StatusBench : test::PublisherBench {
  using PublisherBench::PublisherBench;

  /// Returns the status that a reader gets now.
  Status asked() {
    now += StatusBoard::kFresh;
    made().board().read(now, 0ms);
    step();
    return made().board().read(now, 0ms);
  }
  Values values(const Status& status, std::uint32_t device = 0, std::uint32_t group = 0) const {
    const auto& known = status->values.at(device).at(group);
    return known ? known->by_tag() : Values();
  }
};

/// A sample of the group "fast": temp is good, running as given.
Telemetry fast(std::uint64_t seq, std::int64_t ts_ms, double temp, TagReading running) {
  Telemetry message = test::sample(seq);
  message.ts_ms = ts_ms;
  message.readings = {test::good(test::temp, Value(temp)), std::move(running)};
  return message;
}

TagReading off() { return test::good(test::running, Value(false)); }

Telemetry written(std::uint64_t seq, std::int64_t ts_ms, double temp) {
  Telemetry message = test::sample(seq);
  message.ts_ms = ts_ms;
  message.partial = true;
  message.written = true;
  message.readings = {test::good(test::temp, Value(temp))};
  return message;
}

struct AgentStatusTest : ::testing::Test {
  StatusBench bench;
};
struct AgentStatusOnlineTest : AgentStatusTest {
  AgentStatusOnlineTest() { bench.online(); }
};

TEST_F(AgentStatusOnlineTest, IsMadeAtEachTickOfHealthAndWhenAReaderAsks) {
  StatusBoard& board = bench.made().board();
  bench.advance(60s);
  const SteadyTime tick = bench.now;
  const Status first = board.read(tick, 0ms);
  ASSERT_NE(first, nullptr);
  EXPECT_EQ(first->ts_ms, bench.utc());
  bench.advance(5s);
  EXPECT_EQ(board.read(tick, 0ms), first) << "nobody asked";
  EXPECT_EQ(board.read(bench.now, 0ms), first);
  bench.step();
  const Status second = board.read(bench.now, 0ms);
  EXPECT_NE(second, first);
  EXPECT_EQ(second->ts_ms, bench.utc());
}

TEST_F(AgentStatusTest, TellsWhetherTheBrokerIsThereWhyNotAndSinceWhen) {
  bench.broker.reachable = false;
  bench.broker.answers = false;
  const std::int64_t start = bench.utc();
  bench.step();
  BrokerStatus broker = bench.asked()->broker;
  EXPECT_FALSE(broker.connected);
  EXPECT_EQ(broker.since_ms, start);
  EXPECT_EQ(broker.why, "") << "it is being tried";
  EXPECT_EQ(broker.server, bench.config.mqtt.servers.front());
  bench.broker.answers = true;
  bench.advance(60s);  // the first attempt times out, another is refused
  bench.advance(60s);
  EXPECT_EQ(bench.asked()->broker.why, "connection refused");
  EXPECT_EQ(bench.asked()->broker.since_ms, start) << "it was never connected";
}

TEST_F(AgentStatusOnlineTest, TellsSinceWhenTheBrokerIsConnectedOrLost) {
  const std::int64_t connected = bench.utc();
  bench.advance(20s);
  BrokerStatus broker = bench.asked()->broker;
  EXPECT_TRUE(broker.connected);
  EXPECT_LE(broker.since_ms, connected);
  EXPECT_EQ(broker.why, "");
  bench.broker.reachable = false;
  bench.broker.lose();
  bench.step();
  const std::int64_t lost = bench.utc();
  broker = bench.asked()->broker;
  EXPECT_FALSE(broker.connected);
  EXPECT_EQ(broker.since_ms, lost);
  EXPECT_TRUE(broker.why == "connection closed" || broker.why == "connection refused")
      << broker.why;
}

TEST(AgentStatus, TellsSinceWhenTheDiskRefuses) {
  const test::Scratch scratch;
  std::ofstream(scratch.path("store")) << "a file in its place";
  StatusBench bench(scratch.path("store"));
  const std::int64_t refused = bench.asked()->ts_ms;
  bench.advance(5s);
  EXPECT_EQ(bench.asked()->store_state, "memory");
  EXPECT_EQ(bench.asked()->store_since_ms, refused);
  std::filesystem::remove(scratch.path("store"));
  bench.advance(10s);
  EXPECT_EQ(bench.asked()->store_state, "disk");
  EXPECT_GT(bench.asked()->store_since_ms, refused);
}

TEST_F(AgentStatusOnlineTest, HealthSaysWhatThePublishedStatusSays) {
  bench.outbox.push(test::sample(1));
  bench.outbox.push(test::counted(3, 2));
  bench.advance(60s);
  const Status status = bench.made().board().read(bench.now, 0ms);
  EXPECT_EQ(bench.broker.on(kBase + "/health").back(),
            fxagent::json::health(*status, bench.config));
  EXPECT_EQ(status->samples.collected, 3U);
}

TEST_F(AgentStatusOnlineTest, TellsHowLongTheStoreLastsFromTheFirstMinuteWithSamplesOn) {
  const auto hours_left = [&] { return bench.asked()->hours_left; };
  bench.take_samples(1);
  EXPECT_EQ(hours_left(), std::nullopt);
  bench.advance(60s);
  const auto after_a_minute = hours_left();
  ASSERT_TRUE(after_a_minute);
  bench.advance(60s);
  bench.advance(60s);
  EXPECT_EQ(hours_left(), after_a_minute) << "minutes without samples say nothing of the rate";
  // As many bytes as in the first minute, in about three minutes.
  bench.take_samples(2);
  bench.advance(60s);
  ASSERT_TRUE(hours_left());
  EXPECT_GT(*hours_left(), 1.5 * *after_a_minute);
}

TEST_F(AgentStatusOnlineTest, DoesNotKnowHowLongTheStoreLastsBeforeTheFirstSample) {
  bench.advance(60s);
  EXPECT_EQ(bench.asked()->hours_left, std::nullopt);
}

TEST_F(AgentStatusTest, IsMadeWithoutABrokerToo) {
  bench.broker.reachable = false;
  bench.made().board().want_values();
  bench.report(fast(1, 1000, 23.5, off()));
  bench.advance(60s);
  const Status status = bench.made().board().read(bench.now, 0ms);
  ASSERT_NE(status, nullptr);
  EXPECT_EQ(bench.values(status).at("temp").value, Value(23.5));
}

TEST_F(AgentStatusOnlineTest, ReaderKeepsItsOwnWhileTheUplinkGoesOn) {
  bench.made().board().want_values();
  bench.outbox.push(fast(1, 1000, 23.5, off()));
  bench.outbox.push(test::offline(0, "timeout"));
  bench.outbox.push(test::counted(1, 0));
  bench.write("a");
  bench.report(bench.succeeded("a"));
  const Status kept = bench.asked();
  bench.outbox.push(written(2, 2000, 99));
  bench.outbox.push(fast(3, 3000, 12.5, off()));
  bench.outbox.push(test::offline(0, "link_down"));
  bench.outbox.push(test::counted(10, 7));
  bench.write("b");
  bench.report(bench.succeeded("b"));
  const Status next = bench.asked();
  EXPECT_EQ(bench.values(kept).at("temp").value, Value(23.5));
  EXPECT_EQ(bench.values(next).at("temp").value, Value(12.5));
  EXPECT_EQ(kept->devices.at(0)->reason, "timeout");
  EXPECT_EQ(next->devices.at(0)->reason, "link_down");
  EXPECT_EQ(kept->field->devices.at(0).suppressed, 0U);
  EXPECT_EQ(next->field->devices.at(0).suppressed, 7U);
  EXPECT_EQ(kept->last_commands.size(), 1U);
  EXPECT_EQ(next->last_commands.size(), 2U);
}

TEST_F(AgentStatusOnlineTest, ValuesAreKeptOnceAReaderWantsThem) {
  bench.report(fast(1, 1000, 23.5, off()));
  EXPECT_TRUE(bench.asked()->values.empty());
  bench.made().board().want_values();
  EXPECT_TRUE(bench.asked()->values.empty()) << "nothing was reported since";
  bench.report(fast(2, 2000, 24.5, off()));
  const Status status = bench.asked();
  EXPECT_EQ(bench.values(status).at("temp").value, Value(24.5));
  EXPECT_TRUE(bench.values(status, 0, 1).empty()) << "another group";
  EXPECT_TRUE(bench.values(status, 1).empty()) << "another device";
}

TEST_F(AgentStatusTest, GoodValueIsAsOldAsItsSample) {
  bench.made().board().want_values();
  bench.report(fast(1, 900, 23.5, off()));
  const LastValue temp = bench.values(bench.asked()).at("temp");
  EXPECT_EQ(temp.value, Value(23.5));
  EXPECT_EQ(temp.bad, std::nullopt);
  EXPECT_EQ(temp.type, DataType::int16);
  EXPECT_TRUE(temp.scaled);
  EXPECT_EQ(temp.ts_ms, 900);
}

TEST_F(AgentStatusTest, BadValueIsTheLastGoodOneAndSaysSinceWhenAndWhy) {
  bench.made().board().want_values();
  TagReading stale = off();
  stale.bad = BadReason::nak;
  stale.bad_since_ms = 900;
  stale.last_ms = 700;
  TagReading never;
  never.tag = test::pressure;
  never.bad = BadReason::unsupported;
  never.bad_since_ms = 600;
  Telemetry message = fast(1, 1000, 23.5, stale);
  message.readings.push_back(never);
  bench.report(message);
  const Values values = bench.values(bench.asked());
  EXPECT_EQ(values.at("running").value, Value(false));
  EXPECT_EQ(values.at("running").bad, BadReason::nak);
  EXPECT_EQ(values.at("running").bad_since_ms, 900);
  EXPECT_EQ(values.at("running").ts_ms, 700);
  EXPECT_TRUE(values.at("pressure").value.items.empty());
  EXPECT_EQ(values.at("pressure").bad, BadReason::unsupported);
  EXPECT_EQ(values.at("pressure").ts_ms, std::nullopt);
  EXPECT_EQ(values.at("temp").bad, std::nullopt);
}

TEST_F(AgentStatusTest, PartialSampleChangesItsTagUntilTheNextWholeOne) {
  bench.made().board().want_values();
  bench.outbox.push(fast(1, 1000, 23.5, off()));
  bench.outbox.push(written(2, 2000, 50));
  bench.outbox.push(written(3, 3000, 60));
  bench.settle();
  Values values = bench.values(bench.asked());
  EXPECT_EQ(values.size(), 2U);
  EXPECT_EQ(values.at("temp").value, Value(60.0));
  EXPECT_EQ(values.at("temp").ts_ms, 3000);
  EXPECT_EQ(values.at("running").ts_ms, 1000);
  bench.report(fast(4, 4000, 61, off()));
  values = bench.values(bench.asked());
  EXPECT_EQ(values.at("temp").value, Value(61.0));
  EXPECT_EQ(values.at("temp").ts_ms, 4000);
}

TEST_F(AgentStatusTest, PartialSampleBeforeAnyWholeOneIsAllThatIsKnown) {
  bench.made().board().want_values();
  bench.report(written(1, 2000, 50));
  const Values values = bench.values(bench.asked());
  EXPECT_EQ(values.size(), 1U);
  EXPECT_EQ(values.at("temp").value, Value(50.0));
}

TEST(AgentStatus, WhatAnEarlierRunReadIsNoLastValue) {
  const test::Scratch scratch;
  {
    StatusBench bench(scratch.path("store"));
    bench.broker.reachable = false;
    bench.report(fast(1, 1000, 23.5, off()));
    bench.made().stop(bench.now);
    bench.advance(10s);
  }
  StatusBench again(scratch.path("store"));
  again.made().board().want_values();
  again.online();
  const Status status = again.asked();
  EXPECT_EQ(status->samples.recovered, 1U);
  EXPECT_TRUE(status->values.empty());
  again.report(fast(2, 2000, 24.5, off()));
  EXPECT_EQ(again.values(again.asked()).at("temp").ts_ms, 2000);
}

TEST_F(AgentStatusOnlineTest, DeviceIsAsItsRetainedStateAndHasNoCodec) {
  DeviceStatus state = test::offline(1, "timeout", 77);
  state.codec = test::codec();
  bench.report(state);
  const Status status = bench.asked();
  EXPECT_EQ(status->devices.at(0), nullptr) << "it has not said yet";
  ASSERT_NE(status->devices.at(1), nullptr);
  EXPECT_EQ(status->devices[1]->reason, "timeout");
  EXPECT_EQ(status->devices[1]->since_ms, 77);
  EXPECT_EQ(status->devices[1]->codec, nullptr);
  EXPECT_EQ(status->devices[1], bench.asked()->devices[1]) << "shared, not copied";
}

TEST_F(AgentStatusTest, SaysHowItStandsWithTheBroker) {
  bench.broker.confirms = false;
  bench.broker.reachable = false;
  bench.settle();
  EXPECT_FALSE(bench.asked()->broker.connected);
  EXPECT_EQ(bench.asked()->broker.server.substr(0, 7), "mqtt://");
  bench.broker.reachable = true;
  for (int i = 0; i < 60 && !bench.broker.up(); ++i) bench.advance(1s);
  ASSERT_TRUE(bench.broker.up());
  bench.advance(2s);
  const BrokerStatus silent = bench.asked()->broker;
  EXPECT_TRUE(silent.connected);
  EXPECT_FALSE(silent.subscribed);
  EXPECT_FALSE(silent.not_heard_why.empty());
  bench.broker.confirms = true;
  for (int i = 0; i < 60 && !bench.asked()->broker.subscribed; ++i) bench.advance(1s);
  const BrokerStatus heard = bench.asked()->broker;
  EXPECT_TRUE(heard.subscribed);
  EXPECT_EQ(heard.not_heard_why, "");
}

TEST_F(AgentStatusOnlineTest, CommandsAreNotReceivedInAStop) {
  bench.broker.acknowledges = false;
  bench.outbox.push(test::sample(1));
  bench.step();
  bench.made().stop(bench.now);
  const BrokerStatus broker = bench.asked()->broker;
  EXPECT_TRUE(broker.connected);
  EXPECT_FALSE(broker.subscribed);
  EXPECT_EQ(broker.not_heard_why, "the agent is stopping");
}

TEST_F(AgentStatusOnlineTest, NamesWhatTheBrokerRefusesUntilItAccepts) {
  const auto refused_with = [&](const char* topic) {
    bench.broker.refuses_topic = topic;
    bench.advance(60s);
    return bench.asked()->broker.refused;
  };
  EXPECT_TRUE(bench.asked()->broker.refused.empty());
  EXPECT_EQ(refused_with("/health"), Kinds{"states"});
  bench.outbox.push(test::succeeded("a"));
  EXPECT_EQ(refused_with("/result"), Kinds{"results"});
  EXPECT_TRUE(refused_with("").empty());
}

TEST_F(AgentStatusOnlineTest, RefusalOfWhatTheConfigDoesNotNeedDoesNotCount) {
  bench.made();
  Config wanted = bench.config;
  wanted.devices = {bench.config.devices[1]};
  const ConfigChange change = change_between(bench.config, std::move(wanted));
  bench.broker.refuses_topic = "/press1/";
  bench.outbox.post([&](SteadyTime) { bench.made().begin_change(change); });
  bench.step();
  bench.outbox.post([&](SteadyTime at) { (void)bench.made().change(change, at); });
  bench.advance(60s);
  EXPECT_EQ(bench.asked()->broker.refused, Kinds{}) << "its topics are to be cleared";
  EXPECT_FALSE(bench.broker.on(kBase + "/press1/state").empty());
  bench.command(R"({"id":"a","op":"read","tag":"temp"})");
  bench.advance(60s);
  EXPECT_EQ(bench.asked()->broker.refused, Kinds{}) << "no device or link has this name";
  EXPECT_FALSE(bench.broker.on(kBase + "/press1/result").empty());
}

TEST_F(AgentStatusOnlineTest, RefusedClearOfTheConfigReportDoesNotCount) {
  bench.broker.refuses_topic = "/config/reported";
  bench.made().own_topics().report_config("{}", {});
  bench.advance(60s);
  EXPECT_EQ(bench.asked()->broker.refused, Kinds{"states"});
  bench.made().own_topics().report_config("", {});
  bench.advance(60s);
  EXPECT_EQ(bench.asked()->broker.refused, Kinds{});
}

TEST_F(AgentStatusOnlineTest, BrokerThatIsAwayAndALibraryThatFailsRefuseNothing) {
  bench.broker.refuses_topic = "/health";
  bench.advance(60s);
  bench.broker.reachable = false;
  bench.broker.lose();
  bench.step();
  EXPECT_EQ(bench.asked()->broker.refused, Kinds{});
  bench.broker.refuses_topic.clear();
  bench.broker.reachable = true;
  bench.advance(60s);
  bench.broker.fails = true;
  bench.outbox.push(test::succeeded("a"));
  bench.advance(60s);
  ASSERT_TRUE(bench.asked()->broker.connected);
  EXPECT_EQ(bench.asked()->broker.refused, Kinds{});
}

TEST_F(AgentStatusOnlineTest, SaysWhenTheFieldHasToldItsCounters) {
  EXPECT_FALSE(bench.asked()->field_heard);
  bench.report(test::counted(0, 0));
  const SteadyTime told = bench.now;
  bench.advance(3s);
  const Status status = bench.asked();
  EXPECT_EQ(status->field_heard, told);
  EXPECT_EQ(status->made_at, bench.now);
}

TEST_F(AgentStatusOnlineTest, CountsHowLongCommandsTookThatWereSent) {
  bench.write("a");
  bench.now += 40ms;
  bench.report(bench.succeeded("a"));
  bench.write("a");
  bench.command(R"({"id":"b","op":"write","tag":"no_such_tag","value":50})");
  bench.settle();
  const DurationHistogram counted = bench.asked()->command_durations;
  EXPECT_EQ(counted.sum(), 40ms);
  EXPECT_EQ(counted.counts()[5], 1U) << "above 25 and up to 50 ms";
}

// With -DFXAGENT_SANITIZE=thread this shows that readers and uplink do not race.
TEST_F(AgentStatusTest, ReadersOnOtherThreadsSeeWholeOnesThatGoForward) {
  Publisher& publisher = bench.made();
  StatusBoard& board = publisher.board();
  board.want_values();
  bench.outbox.push(fast(1, 1, 1, off()));
  bench.outbox.push(test::offline(0, "timeout"));
  std::stop_source stop;
  std::thread uplink([&] { run_uplink(publisher, bench.outbox, stop.get_token()); });
  const auto read = [&] {
    std::int64_t last = 0;
    // The reader's clock runs ahead, so that every read requests a new status.
    for (int i = 0; i < 50; ++i) {
      const auto soon = std::chrono::steady_clock::now() + 1h;
      const Status status = board.read(soon, 10s);
      ASSERT_NE(status, nullptr);
      const Values values = bench.values(status);
      const std::int64_t ts_ms = values.at("temp").ts_ms.value();
      EXPECT_GE(ts_ms, last);
      EXPECT_EQ(values.at("temp").value, Value(static_cast<double>(ts_ms)));
      EXPECT_EQ(status->devices.at(0)->reason, "timeout");
      last = ts_ms;
    }
  };
  std::thread one(read);
  std::thread two(read);
  for (std::int64_t seq = 2; seq <= 500; ++seq)
    bench.outbox.push(fast(static_cast<std::uint64_t>(seq), seq, static_cast<double>(seq), off()));
  one.join();
  two.join();
  stop.request_stop();
  uplink.join();
  EXPECT_TRUE(publisher.finished());
}

}  // namespace
}  // namespace fxagent
