#include "agent/uplink/publisher.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <stop_token>
#include <thread>
#include <tuple>

#include "agent/uplink/audit_report.h"
#include "agent/uplink/recall.h"
#include "tests/agent/uplink/fake_broker.h"
#include "tests/agent/uplink/plant.h"
#include "tests/agent/uplink/scratch.h"

namespace fxagent {
namespace {

using nlohmann::json;
using namespace std::chrono_literals;

const std::string kBase = "fx/plant-a/edge7";
const SteadyTime kStart{std::chrono::hours(1)};

/// A publisher with everything around it, and a clock that the test moves.
struct Bench {
  Config config = test::plant();
  Outbox outbox{1000};
  test::FakeBroker broker;
  std::vector<Command> commands;
  std::vector<std::string> go_aheads;
  std::vector<Recollection> found_late;
  SteadyTime now = kStart;
  PublisherSettings settings{.boot = "9f3c21aa", .version = "0.1.0"};
  std::unique_ptr<Store> store;  ///< null: none
  std::unique_ptr<Publisher> publisher;

  /// With a store in this directory, opened at the first step.
  explicit Bench(const std::string& directory = {}) { config.store.path = directory; }
  Publisher& made() {
    if (!publisher && !config.store.path.empty())
      store = std::make_unique<Store>(config.store, utc());
    if (!publisher)
      publisher = std::make_unique<Publisher>(
          config, settings, outbox, broker, [this](Command c) { commands.push_back(std::move(c)); },
          [this] { return utc(); }, store.get(),
          [this](std::uint32_t device, std::string id) {
            go_aheads.push_back(std::to_string(device) + id);
          },
          [this](Recollection found) { found_late.push_back(std::move(found)); });
    return *publisher;
  }
  std::int64_t utc() const { return 1790000000000 + now.time_since_epoch() / 1ms; }
  SteadyTime step() {
    const SteadyTime wake = made().step(now);
    EXPECT_TRUE(publisher->samples().balanced());
    return wake;
  }
  /// Steps until nothing moves any more at this time.
  void settle() {
    for (int i = 0; i < 200; ++i) step();
  }
  void advance(SteadyTime::duration by) {
    now += by;
    settle();
  }
  /// Connected for so long that the server counts as a good one.
  void online() {
    settle();
    advance(20s);
    ASSERT_TRUE(broker.up());
    broker.log.clear();
    broker.taken.clear();
    broker.order.clear();
  }
  void command(const std::string& payload, const std::string& topic = kBase + "/press1/command") {
    Message message;
    message.topic = topic;
    message.payload = payload;
    message.received = now;
    message.received_ms = 1790000000500;
    broker.send(std::move(message));
    step();
  }
};

std::vector<std::uint64_t> seqs(const std::vector<std::string>& payloads) {
  std::vector<std::uint64_t> found;
  for (const std::string& payload : payloads) {
    const json parsed = json::parse(payload);
    if (parsed.contains("rows"))
      for (const json& row : parsed["rows"]) found.push_back(row["seq"]);
    else
      found.push_back(parsed["seq"]);
  }
  return found;
}

TEST(Publisher, ConnectSubscribesThenPublishesEverythingRetained) {
  Bench bench;
  bench.outbox.push(test::offline(0, "timeout"));
  bench.settle();
  const std::vector<std::string> expected{"subscribe " + kBase + "/+/command",
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

TEST(Publisher, EveryRetainedTopicComesAgainAfterAReconnect) {
  Bench bench;
  bench.outbox.push(test::offline(1, "timeout"));
  bench.online();
  bench.broker.lose();
  bench.settle();
  bench.advance(2s);
  EXPECT_EQ(bench.broker.on(kBase + "/state").size(), 1U);
  EXPECT_EQ(bench.broker.on(kBase + "/press1/meta").size(), 1U);
  EXPECT_EQ(bench.broker.on(kBase + "/health").size(), 1U);
  ASSERT_EQ(bench.broker.on(kBase + "/press2/state").size(), 1U);
  EXPECT_EQ(json::parse(bench.broker.on(kBase + "/press2/state")[0])["reason"], "timeout");
}

TEST(Publisher, AcknowledgementWakesNobodyWhoDoesNotWaitForIt) {
  Bench bench;
  bench.online();
  bench.broker.acknowledges = false;
  bench.outbox.push(test::sample(1));
  const SteadyTime wake = bench.step();
  EXPECT_EQ(bench.broker.open(), 1U);
  EXPECT_FALSE(bench.broker.acknowledgements_awaited);
  EXPECT_LE(wake, bench.now + 50ms);  // it is noted soon all the same
  bench.outbox.push(test::succeeded("b7e1"));
  bench.step();
  EXPECT_TRUE(bench.broker.acknowledgements_awaited) << "a result is marked as told";
  bench.broker.acknowledge_all();
  bench.settle();
  EXPECT_FALSE(bench.broker.acknowledgements_awaited);
  for (std::uint64_t seq = 2; seq < 30; ++seq) bench.outbox.push(test::sample(seq));
  bench.step();
  EXPECT_TRUE(bench.broker.acknowledgements_awaited) << "the window is full";
}

TEST(Publisher, SamplesGatherForAHundredthOfTheirIntervalWhileTheyStream) {
  Bench bench;
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

TEST(Publisher, SampleGoesOutLiveAtTheDataQos) {
  Bench bench;
  bench.config.mqtt.qos = 0;
  bench.online();
  bench.outbox.push(test::sample(7, 1, 1));
  bench.settle();
  ASSERT_EQ(bench.broker.taken.size(), 1U);
  const Publication& live = bench.broker.taken[0];
  EXPECT_EQ(live.topic, kBase + "/press2/data/slow");
  EXPECT_EQ(live.qos, 0);
  EXPECT_EQ(live.retain, Retain::no);
  EXPECT_EQ(json::parse(live.payload)["meta"],
            json::parse(fxagent::json::device_meta(bench.config.devices[1]).text)["hash"]);
  EXPECT_EQ(bench.made().samples().acknowledged, 1U);
}

TEST(Publisher, WindowIsKeptAndResultsStillFindRoom) {
  Bench bench;
  bench.online();
  bench.broker.acknowledges = false;
  for (std::uint64_t seq = 1; seq <= 100; ++seq) bench.outbox.push(test::sample(seq));
  bench.settle();
  EXPECT_EQ(bench.broker.open(), 18U);
  bench.outbox.push(test::succeeded("a"));
  bench.settle();
  EXPECT_EQ(bench.broker.on(kBase + "/press1/result").size(), 1U);
  for (const char* id : {"b", "c", "d"}) bench.outbox.push(test::succeeded(id));
  bench.settle();
  EXPECT_EQ(bench.broker.open(), 20U);
  EXPECT_EQ(bench.broker.most_open, 20U);
}

TEST(Publisher, SmallerReceiveMaximumIsObeyed) {
  Bench bench;
  bench.broker.receive_maximum = 3;
  bench.broker.acknowledges = false;
  for (std::uint64_t seq = 1; seq <= 10; ++seq) bench.outbox.push(test::sample(seq));
  bench.settle();
  for (int i = 0; i < 50; ++i) {
    EXPECT_LE(bench.broker.open(), 3U);
    if (bench.broker.open() > 0) bench.broker.acknowledge_next();
    bench.settle();
  }
  EXPECT_EQ(bench.broker.most_open, 3U);
  EXPECT_EQ(bench.made().samples().acknowledged, 10U);
}

TEST(Publisher, UnacknowledgedSamplesComeAgainAsHistoryBesideLiveOnes) {
  Bench bench;
  bench.online();
  bench.broker.acknowledges = false;
  for (std::uint64_t seq = 1; seq <= 3; ++seq) bench.outbox.push(test::sample(seq));
  bench.settle();
  bench.broker.lose();
  bench.outbox.push(test::sample(4));
  bench.settle();
  EXPECT_EQ(bench.made().samples().stored, 4U);
  bench.broker.acknowledges = true;
  bench.broker.log.clear();
  bench.now += 2s;
  bench.outbox.push(test::sample(5));  // before the reconnect: history too
  bench.settle();
  bench.outbox.push(test::sample(6));
  bench.settle();
  EXPECT_EQ(seqs(bench.broker.on(kBase + "/press1/data/fast/history")),
            (std::vector<std::uint64_t>{1, 2, 3, 4, 5}));
  EXPECT_EQ(seqs(bench.broker.on(kBase + "/press1/data/fast")), (std::vector<std::uint64_t>{6}));
  const json history = json::parse(bench.broker.on(kBase + "/press1/data/fast/history").at(0));
  EXPECT_EQ(history["history"], true);
  EXPECT_TRUE(history["rows"][0].contains("boot") && history["rows"][0].contains("values"));
  const fxagent::json::Samples samples = bench.made().samples();
  EXPECT_EQ(samples.acknowledged, 6U);
  EXPECT_EQ(samples.stored, 0U);
  EXPECT_EQ(samples.published, 9U);  // three of them twice
}

TEST(Publisher, RowsLeaveMemoryOnlyAfterTheirAcknowledgement) {
  Bench bench;
  bench.broker.reachable = false;
  for (std::uint64_t seq = 1; seq <= 3; ++seq) bench.outbox.push(test::sample(seq));
  bench.settle();
  bench.broker.reachable = true;
  bench.advance(40s);
  bench.advance(20s);
  EXPECT_EQ(bench.made().samples().stored, 0U);
  bench.broker.lose();
  bench.outbox.push(test::sample(4));
  bench.settle();
  bench.broker.acknowledges = false;
  bench.advance(40s);
  EXPECT_EQ(seqs(bench.broker.on(kBase + "/press1/data/fast/history")),
            (std::vector<std::uint64_t>{1, 2, 3, 4}));
  EXPECT_EQ(bench.made().samples().stored, 1U);
  bench.broker.acknowledge_all();
  bench.settle();
  EXPECT_EQ(bench.made().samples().stored, 0U);
}

TEST(Publisher, HistoryMessagesStayBelowTheirLimit) {
  Bench bench;
  bench.broker.reachable = false;
  for (std::uint64_t seq = 1; seq <= 999; ++seq) bench.outbox.push(test::sample(seq));
  bench.settle();
  bench.broker.reachable = true;
  bench.advance(40s);
  const auto messages = bench.broker.on(kBase + "/press1/data/fast/history");
  EXPECT_GT(messages.size(), 1U);
  for (const std::string& message : messages) EXPECT_LE(message.size(), 65536U);
  EXPECT_EQ(seqs(messages).size(), 999U);
}

TEST(Publisher, SampleThatFindsNoRoomForASecondBecomesHistory) {
  Bench bench;
  bench.online();
  bench.broker.acknowledges = false;
  for (std::uint64_t seq = 1; seq <= 20; ++seq) bench.outbox.push(test::sample(seq));
  bench.settle();
  EXPECT_EQ(bench.made().samples().queued, 2U);
  bench.advance(1s);
  EXPECT_EQ(bench.made().samples().queued, 0U);
  EXPECT_EQ(bench.made().samples().stored, 2U);
  bench.broker.acknowledges = true;
  bench.broker.acknowledge_all();
  bench.settle();
  EXPECT_EQ(seqs(bench.broker.on(kBase + "/press1/data/fast/history")),
            (std::vector<std::uint64_t>{19, 20}));
}

TEST(Publisher, FullBacklogDropsTheOldestAndCountsThem) {
  Bench bench;
  bench.settings.backlog_bytes = 3000;
  bench.broker.reachable = false;
  for (std::uint64_t seq = 1; seq <= 50; ++seq) bench.outbox.push(test::sample(seq, 1));
  bench.settle();
  const std::uint64_t dropped = bench.made().samples().dropped;
  EXPECT_GT(dropped, 30U);
  bench.broker.reachable = true;
  bench.advance(40s);
  const auto arrived = seqs(bench.broker.on(kBase + "/press2/data/fast/history"));
  ASSERT_EQ(arrived.size(), 50 - dropped);
  EXPECT_EQ(arrived.front(), dropped + 1);
  const json health = json::parse(bench.broker.on(kBase + "/health").back());
  EXPECT_EQ(health["devices"]["press2"]["dropped"], dropped);
  EXPECT_EQ(health["samples"]["dropped"], dropped);
}

// ---- with a store on disk
// -------------------------------------------------------------------------

TEST(PublisherStore, SamplesOfAnOutageOutliveTheProcess) {
  const test::Scratch scratch;
  {
    Bench bench(scratch.path("store"));
    bench.broker.reachable = false;
    for (std::uint64_t seq = 1; seq <= 3; ++seq) bench.outbox.push(test::sample(seq));
    bench.settle();
    EXPECT_EQ(bench.made().samples().queued, 3U);  // gathered for one commit
    bench.advance(200ms);
    EXPECT_EQ(bench.made().samples().stored, 3U);
  }  // no goodbye
  Bench again(scratch.path("store"));
  again.outbox.push(test::sample(4));
  again.settle();
  EXPECT_EQ(seqs(again.broker.on(kBase + "/press1/data/fast/history")),
            (std::vector<std::uint64_t>{1, 2, 3}));
  EXPECT_EQ(seqs(again.broker.on(kBase + "/press1/data/fast")), std::vector<std::uint64_t>{4});
  const fxagent::json::Samples samples = again.made().samples();
  EXPECT_EQ(samples.recovered, 3U);
  EXPECT_EQ(samples.acknowledged, 4U);
  EXPECT_EQ(samples.stored, 0U);
  const json health = json::parse(again.broker.on(kBase + "/health").at(0));
  EXPECT_EQ(health["store"]["state"], "disk");
  EXPECT_EQ(health["samples"]["balanced"], true);
}

TEST(PublisherStore, UnacknowledgedForASecondIsOnDiskAndStillInFlight) {
  const test::Scratch scratch;
  Bench bench(scratch.path("store"));
  bench.online();
  bench.broker.acknowledges = false;
  for (std::uint64_t seq = 1; seq <= 20; ++seq) bench.outbox.push(test::sample(seq));
  bench.settle();
  EXPECT_EQ(bench.made().samples().in_flight, 18U);
  EXPECT_LE(bench.step(), bench.now + 1s);
  bench.advance(1s);
  EXPECT_EQ(bench.made().samples().in_flight, 0U);
  EXPECT_EQ(bench.made().samples().stored, 20U);
  EXPECT_TRUE(bench.broker.on(kBase + "/press1/data/fast/history").empty());
  bench.broker.acknowledge_all();
  bench.settle();
  EXPECT_EQ(bench.made().samples().acknowledged, 18U);
  EXPECT_EQ(seqs(bench.broker.on(kBase + "/press1/data/fast/history")),
            (std::vector<std::uint64_t>{19, 20}));
  bench.broker.acknowledge_all();
  bench.advance(1s);
  EXPECT_EQ(bench.made().samples().acknowledged, 20U);
  bench.store.reset();
  EXPECT_EQ(Bench(scratch.path("store")).made().samples().recovered, 0U);
}

TEST(PublisherStore, SamplesOfOneFifthOfASecondGoToDiskTogether) {
  const test::Scratch scratch;
  Bench bench(scratch.path("store"));
  bench.online();
  bench.broker.acknowledges = false;
  const SteadyTime first = bench.now;
  for (std::uint64_t seq = 1; seq <= 30; ++seq) {  // 18 in flight, 12 behind them
    bench.outbox.push(test::sample(seq));
    bench.step();
    bench.now += 10ms;
  }
  bench.now = first + 999ms;
  bench.step();
  EXPECT_EQ(bench.made().samples().stored, 0U);
  bench.now = first + 1s;
  bench.step();
  EXPECT_EQ(bench.store->rows(), 18U);  // those of the first 200 ms in flight
  bench.now = first + 1180ms;
  bench.step();
  EXPECT_EQ(bench.store->rows(), 30U);
}

TEST(PublisherStore, SampleInFlightWhenTheConnectionGoesIsOnDiskWithinItsSecond) {
  const test::Scratch scratch;
  Bench bench(scratch.path("store"));
  bench.online();
  bench.broker.acknowledges = false;
  bench.outbox.push(test::sample(1));
  bench.settle();
  bench.advance(900ms);
  bench.broker.lose();
  bench.now += 50ms;
  bench.step();
  EXPECT_EQ(bench.store->rows(), 0U);  // it may have company
  EXPECT_LE(bench.step(), bench.now + 50ms);
  bench.advance(50ms);
  EXPECT_EQ(bench.store->rows(), 1U);
}

TEST(PublisherStore, DamagedFileIsNamedInHealth) {
  const test::Scratch scratch;
  std::filesystem::create_directories(scratch.path("store"));
  std::ofstream(scratch.path("store") + "/fxagent.db") << std::string(8192, 'x');
  Bench bench(scratch.path("store"));
  bench.settle();
  const json health = json::parse(bench.broker.on(kBase + "/health").at(0));
  const std::string aside = health["store"]["set_aside"];
  EXPECT_TRUE(std::filesystem::exists(scratch.path("store") + "/" + aside)) << aside;
}

TEST(PublisherStore, WithAlwaysEverySampleIsOnDiskBeforeItIsSent) {
  const test::Scratch scratch;
  Bench bench(scratch.path("store"));
  bench.config.store.sync_always = true;
  bench.online();
  bench.broker.acknowledges = false;
  for (std::uint64_t seq = 1; seq <= 3; ++seq) bench.outbox.push(test::sample(seq));
  bench.settle();
  EXPECT_EQ(seqs(bench.broker.on(kBase + "/press1/data/fast")),
            (std::vector<std::uint64_t>{1, 2, 3}));
  EXPECT_EQ(bench.made().samples().stored, 3U);
  bench.broker.acknowledge_next();
  bench.settle();
  EXPECT_EQ(bench.made().samples().acknowledged, 1U);
  bench.advance(200ms);
  bench.store.reset();  // no goodbye
  Bench again(scratch.path("store"));
  again.settle();
  EXPECT_EQ(seqs(again.broker.on(kBase + "/press1/data/fast/history")),
            (std::vector<std::uint64_t>{2, 3}));
}

TEST(PublisherStore, ReconnectInTheMiddleOfTheBacklogLosesAndReordersNothing) {
  const test::Scratch scratch;
  Bench bench(scratch.path("store"));
  bench.broker.reachable = false;
  for (std::uint64_t seq = 1; seq <= 900; ++seq) bench.outbox.push(test::sample(seq));
  bench.settle();
  bench.advance(1s);
  bench.broker.reachable = true;
  bench.broker.acknowledges = false;
  while (!bench.broker.up()) bench.advance(1s);
  for (int i = 0; i < 5; ++i) {
    bench.broker.acknowledge_next();  // the states, and then the first of the history
    bench.settle();
  }
  ASSERT_LT(bench.made().samples().stored, 900U);
  ASSERT_GT(bench.made().samples().stored, 0U);
  ASSERT_GT(bench.broker.open(), 0U);
  bench.broker.lose();
  bench.settle();
  bench.broker.acknowledges = true;
  for (int i = 0; i < 40; ++i) bench.advance(1s);
  std::vector<std::string> taken;
  for (const Publication& p : bench.broker.taken)
    if (p.topic.ends_with("/history")) taken.push_back(p.payload);
  std::vector<std::uint64_t> expected(900);
  for (std::uint64_t i = 0; i < 900; ++i) expected[i] = i + 1;
  EXPECT_EQ(seqs(taken), expected);
  for (const std::string& message : taken) EXPECT_LE(message.size(), 65536U);
}

TEST(PublisherStore, HistoryHasAShareOfTheWindowAndLiveTheRest) {
  const test::Scratch scratch;
  Bench bench(scratch.path("store"));
  bench.broker.reachable = false;
  for (std::uint64_t seq = 1; seq <= 20; ++seq)
    for (std::uint32_t device = 0; device < 2; ++device)
      for (std::uint32_t group = 0; group < 2; ++group)
        bench.outbox.push(test::sample(seq, device, group));
  bench.settle();
  bench.advance(1s);
  bench.broker.reachable = true;
  bench.broker.receive_maximum = 8;
  bench.broker.acknowledges = false;
  bench.advance(5s);
  bench.broker.acknowledge_all();
  bench.settle();
  bench.broker.log.clear();
  bench.outbox.push(test::sample(21));
  bench.settle();
  EXPECT_LE(bench.broker.open(), 2U);  // one of history and the live one
  EXPECT_EQ(seqs(bench.broker.on(kBase + "/press1/data/fast")), std::vector<std::uint64_t>{21});
}

TEST(PublisherStore, HistoryRestsAsLongAsItsLastMessageTook) {
  for (const bool on_disk : {true, false}) {
    const test::Scratch scratch;
    Bench bench(on_disk ? scratch.path("store") : std::string());
    bench.broker.reachable = false;
    for (std::uint64_t seq = 1; seq <= 900; ++seq) bench.outbox.push(test::sample(seq));
    bench.settle();
    bench.advance(1s);
    bench.broker.reachable = true;
    bench.broker.acknowledges = false;
    while (!bench.broker.up()) bench.advance(100ms);
    const auto messages = [&] {
      return bench.broker.on(kBase + "/press1/data/fast/history").size();
    };
    bench.settle();
    while (messages() == 0 || bench.broker.open() > 1) {  // the states come first
      ASSERT_GT(bench.broker.open(), 0U);
      bench.broker.acknowledge_next();
      bench.settle();
    }
    ASSERT_EQ(messages(), 1U);
    bench.advance(10ms);
    bench.broker.acknowledge_next();
    EXPECT_LE(bench.step(), bench.now + 10ms);
    bench.advance(9ms);
    EXPECT_EQ(messages(), 1U);
    bench.advance(1ms);
    ASSERT_EQ(messages(), 2U);
    // A line that is slow by itself is not made slower by much.
    bench.advance(5s);
    bench.broker.acknowledge_next();
    bench.step();
    bench.advance(99ms);
    EXPECT_EQ(messages(), 2U);
    bench.advance(1ms);
    EXPECT_EQ(messages(), 3U);
  }
}

TEST(PublisherStore, DiskThatRefusesIsReplacedByMemoryUntilItTakesAgain) {
  const test::Scratch scratch;
  std::ofstream(scratch.path("store")) << "a file in its place";
  Bench bench(scratch.path("store"));
  bench.broker.reachable = false;
  for (std::uint64_t seq = 1; seq <= 3; ++seq) bench.outbox.push(test::sample(seq));
  bench.settle();
  EXPECT_EQ(bench.store->state(), "memory");
  EXPECT_EQ(bench.made().samples().stored, 3U);
  std::filesystem::remove(scratch.path("store"));
  bench.advance(10s);
  EXPECT_EQ(bench.store->state(), "disk");
  EXPECT_EQ(bench.store->rows(), 3U);
  EXPECT_EQ(bench.made().samples().stored, 3U);
  bench.outbox.push(test::sample(4));
  bench.advance(1s);
  bench.broker.reachable = true;
  bench.advance(40s);
  EXPECT_EQ(seqs(bench.broker.on(kBase + "/press1/data/fast/history")),
            (std::vector<std::uint64_t>{1, 2, 3, 4}));
}

TEST(PublisherStore, CleanStopLeavesTheRestOnDisk) {
  const test::Scratch scratch;
  Bench bench(scratch.path("store"));
  bench.online();
  bench.broker.acknowledges = false;
  for (std::uint64_t seq = 1; seq <= 30; ++seq) bench.outbox.push(test::sample(seq));
  bench.step();
  bench.made().stop(bench.now);
  while (!bench.made().finished()) bench.advance(500ms);
  Bench again(scratch.path("store"));
  again.settle();
  EXPECT_EQ(again.made().samples().recovered, 30U);
  EXPECT_EQ(seqs(again.broker.on(kBase + "/press1/data/fast/history")).size(), 30U);
}

OrderNote note(std::string id, std::string op = "write") {
  OrderNote made;
  made.id = std::move(id);
  made.op = std::move(op);
  made.received_ms = 1790000000000;
  made.deadline_ms = made.received_ms + 10000;
  made.response_topic = "hmi/replies";
  made.correlation = {1, 2};
  return made;
}

TEST(PublisherStore, GoAheadComesWhenTheOrderIsInTheJournal) {
  const test::Scratch scratch;
  Bench bench(scratch.path("store"));
  bench.online();
  bench.outbox.push(note("a"));
  bench.outbox.push(note("b"));
  bench.step();
  EXPECT_EQ(bench.go_aheads, (std::vector<std::string>{"0a", "0b"}));
  const auto known = bench.store->remembered();
  ASSERT_EQ(known.size(), 2U);
  EXPECT_EQ(known[0].device, "press1");
  EXPECT_EQ(known[0].result, "");
}

TEST(PublisherStore, GoAheadComesAtOnceWhereTheDiskRefuses) {
  const test::Scratch scratch;
  std::ofstream(scratch.path("store")) << "a file in its place";
  Bench bench(scratch.path("store"));
  bench.outbox.push(note("a"));
  bench.step();
  EXPECT_EQ(bench.go_aheads, std::vector<std::string>{"0a"});
}

TEST(PublisherStore, KnownIdDuringTheEndIsADuplicate) {
  const test::Scratch scratch;
  Bench bench(scratch.path("store"));
  bench.online();
  CommandResult done = test::succeeded("done");
  done.received_ms = 1790000000400;
  bench.outbox.push(note("done"));
  bench.outbox.push(std::move(done));
  bench.settle();
  bench.broker.log.clear();
  bench.broker.acknowledges = false;
  bench.made().stop(bench.now);
  bench.outbox.push(test::sample(1));
  bench.step();
  bench.command(R"({"id":"done","op":"run"})");
  const auto results = bench.broker.on(kBase + "/press1/result");
  ASSERT_EQ(results.size(), 1U);
  const json told = json::parse(results[0]);
  EXPECT_EQ(told["status"], "DUPLICATE");
  EXPECT_EQ(told["first"]["status"], "SUCCEEDED");
  EXPECT_NE(bench.store->find("press1", "done")->result.find("SUCCEEDED"), std::string::npos);
}

TEST(PublisherStore, StoreThatOpensLateTellsTheFieldWhatItKnows) {
  const test::Scratch scratch;
  const std::string path = scratch.path("store");
  {
    Bench before(path);
    before.online();
    before.broker.acknowledges = false;
    before.outbox.push(note("done"));
    before.outbox.push(test::succeeded("done"));
    before.outbox.push(note("left"));
    before.step();
  }
  std::filesystem::rename(path, path + "-away");  // as a disk that is mounted late
  std::ofstream(path) << "a file in its place";
  Bench bench(path);
  bench.online();
  EXPECT_TRUE(bench.found_late.empty());
  std::filesystem::remove(path);
  std::filesystem::rename(path + "-away", path);
  bench.outbox.push(note("own"));
  bench.step();
  bench.advance(11s);
  bench.advance(11s);
  ASSERT_EQ(bench.found_late.size(), 1U);
  std::set<std::string> ids;
  for (const RememberedResult& known : bench.found_late[0].results) ids.insert(known.result.id);
  EXPECT_EQ(ids, (std::set<std::string>{"done", "left"}));
  // What nobody was told yet is told, and the order of this run is not among them.
  EXPECT_EQ(bench.broker.on(kBase + "/press1/result").size(), 2U);
  ASSERT_TRUE(bench.store->find("press1", "own"));
  EXPECT_EQ(bench.store->find("press1", "own")->result, "");
}

TEST(PublisherStore, RestartKnowsTheResultsAndSaysWhatNobodyWasTold) {
  const test::Scratch scratch;
  std::string first;
  {
    Bench bench(scratch.path("store"));
    bench.online();
    for (const char* id : {"told", "untold", "left"}) bench.outbox.push(note(id));
    bench.outbox.push(note("read", "read"));
    bench.outbox.push(test::succeeded("told"));
    CommandResult rejected = test::succeeded("rejected");
    rejected.status = CommandStatus::rejected;
    rejected.reason = Reason::out_of_range;
    bench.outbox.push(rejected);
    CommandResult dry = test::succeeded("dry");
    dry.dry_run = true;
    bench.outbox.push(dry);
    CommandResult unkept = test::succeeded("unkept");
    unkept.id_kept = false;
    bench.outbox.push(unkept);
    CommandResult again = test::succeeded("left");
    again.status = CommandStatus::duplicate;
    bench.outbox.push(again);
    bench.settle();
    bench.broker.acknowledges = false;
    bench.outbox.push(test::succeeded("untold"));
    bench.advance(1s);
    first = bench.broker.on(kBase + "/press1/result").at(0);
  }  // no goodbye
  Config config = test::plant();
  config.store.path = scratch.path("store");
  Store store(config.store, 1790000001000);
  const Recall known = recall(config, &store, 1790000001000, kStart);
  std::map<std::string, CommandResult> results;
  for (const RememberedResult& each : known.field.results) results[each.result.id] = each.result;
  EXPECT_EQ(results.size(), 5U);
  EXPECT_EQ(results.count("dry") + results.count("unkept"), 0U);
  EXPECT_EQ(results["told"].plc, PlcAnswer::ack);
  EXPECT_EQ(results["told"].status, CommandStatus::succeeded);
  json then = json::parse(first);
  json now = json::parse(results["told"].recorded);
  then["t"].erase("total_ms");
  now["t"].erase("total_ms");
  EXPECT_EQ(now, then);
  std::map<std::string, std::string> untold;
  for (const CommandResult& each : known.untold) {
    untold[each.id] = to_string(each.status);
    EXPECT_EQ(each.response_topic, "hmi/replies");
    EXPECT_EQ(each.correlation, (Bytes{1, 2}));
  }
  EXPECT_EQ(untold, (std::map<std::string, std::string>{
                        {"untold", "SUCCEEDED"}, {"left", "UNKNOWN_OUTCOME"}, {"read", "FAILED"}}));
  // A second start tells the same, as long as nobody has heard it.
  EXPECT_EQ(recall(config, &store, 1790000001000, kStart).untold.size(), 3U);
}

TEST(PublisherStore, ResultOfAnEarlierRunIsPublishedAsItWas) {
  const test::Scratch scratch;
  {
    Bench bench(scratch.path("store"));
    bench.settle();
    bench.outbox.push(note("left"));
    bench.step();
  }
  Bench bench(scratch.path("store"));
  bench.made();
  for (const CommandResult& each :
       recall(bench.config, bench.store.get(), bench.utc(), bench.now).untold)
    bench.outbox.push(each);
  bench.settle();
  const auto results = bench.broker.on(kBase + "/press1/result");
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(json::parse(results[0])["id"], "left");
  EXPECT_EQ(json::parse(results[0])["status"], "UNKNOWN_OUTCOME");
  EXPECT_EQ(bench.broker.on("hmi/replies"), results);
  bench.advance(1s);
  EXPECT_TRUE(recall(bench.config, bench.store.get(), bench.utc(), bench.now).untold.empty());
  CommandResult again;
  again.id = "left";
  again.status = CommandStatus::duplicate;
  again.first = std::make_shared<const CommandResult>(
      recall(bench.config, bench.store.get(), bench.utc(), bench.now).field.results.at(0).result);
  bench.outbox.push(again);
  bench.settle();
  EXPECT_EQ(json::parse(bench.broker.on(kBase + "/press1/result").back())["first"],
            json::parse(results[0]));
}

/// What the audit of the store in this directory says, a line for each command; it is whole.
std::vector<json> audit_lines(const std::string& directory) {
  sqlite::Database database(store_file_path(directory), sqlite::Database::Access::read_only);
  audit::Report report;
  audit::Verifier verifier;
  audit::Head head;
  EXPECT_TRUE(AuditTrail::read(
      database,
      [&](const audit::Record& record) {
        report.add(record);
        verifier.add(record);
      },
      head));
  EXPECT_TRUE(verifier.finish(head).empty());
  std::vector<json> lines;
  for (const audit::Line& line : report.take()) lines.push_back(json::parse(line.json));
  return lines;
}

TEST(PublisherAudit, OrderIsWrittenDownBeforeItsGoAheadAndThenItsFramesAndItsAcknowledgement) {
  const test::Scratch scratch;
  Bench bench(scratch.path("store"));
  bench.online();
  bench.command(R"({"id":"a","op":"write","tag":"setpoint","value":50,"by":"anna"})");
  ASSERT_EQ(bench.commands.size(), 1U);
  OrderNote order = note("a");
  order.arrival = bench.commands[0].arrival;
  bench.outbox.push(order);
  bench.step();
  ASSERT_EQ(bench.go_aheads.size(), 1U);
  auto lines = audit_lines(scratch.path("store"));
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_EQ(lines[0]["id"], "a");
  EXPECT_EQ(lines[0]["by"], "anna");
  EXPECT_EQ(lines[0]["topic"], kBase + "/press1/command");
  EXPECT_EQ(lines[0]["received"], 1790000000500);
  EXPECT_EQ(lines[0]["status"], nullptr);

  CommandResult result = test::succeeded("a");
  result.arrival = order.arrival;
  result.frames.add(WireFrame::Way::out, Bytes{5});
  result.frames.add(WireFrame::Way::in, Bytes{6});
  bench.broker.acknowledges = false;
  bench.outbox.push(result);
  bench.step();
  lines = audit_lines(scratch.path("store"));
  EXPECT_EQ(lines.at(0)["status"], "SUCCEEDED");
  EXPECT_EQ(lines[0]["plc"], "ACK");
  EXPECT_EQ(lines[0]["frames"], json::parse(R"([{"out":"05"},{"in":"06"}])"));
  EXPECT_EQ(lines[0]["acknowledged"], nullptr);

  bench.broker.acknowledge_all();
  bench.step();
  bench.advance(200ms);
  lines = audit_lines(scratch.path("store"));
  EXPECT_EQ(lines.at(0)["acknowledged"], bench.utc() - 200);
  EXPECT_EQ(lines[0]["records"], json::parse("[1,2,3]"));
}

TEST(PublisherAudit, EveryCommandThatNeverBecameAnOrderHasItsLineToo) {
  const test::Scratch scratch;
  Bench bench(scratch.path("store"));
  bench.online();
  const std::string payloads[] = {R"({"id":"a","op":"write"})", R"({"id":"a","op":"write"})",
                                  "{\xFF no json", std::string(70000, 'x')};
  for (const std::string& payload : payloads) {
    bench.command(payload);
    CommandResult result;
    result.arrival = bench.commands.back().arrival;
    result.id = bench.commands.back().id;
    result.reason = Reason::bad_json;
    if (bench.commands.size() == 2) {
      result.status = CommandStatus::duplicate;
      result.reason = Reason::duplicate_id;
      result.first = std::make_shared<const CommandResult>(test::succeeded("a"));
    }
    bench.outbox.push(std::move(result));
    bench.step();
  }
  bench.advance(1s);
  const auto lines = audit_lines(scratch.path("store"));
  ASSERT_EQ(lines.size(), 4U);
  EXPECT_EQ(lines[0]["status"], "REJECTED");
  EXPECT_EQ(lines[1]["status"], "DUPLICATE");
  EXPECT_FALSE(lines[1].contains("first"));
  EXPECT_EQ(lines[2]["payload"], "{\\xff no json");
  EXPECT_EQ(lines[2]["id"], nullptr);
  EXPECT_EQ(lines[3]["payload_bytes"], 70000);
  EXPECT_EQ(lines[3]["payload"].get<std::string>().size(), audit::kPayloadKept);
  for (const json& line : lines) EXPECT_NE(line["acknowledged"], nullptr);
}

TEST(PublisherAudit, ResultThatTheBrokerRefusesForGoodIsNotAcknowledged) {
  const test::Scratch scratch;
  Bench bench(scratch.path("store"));
  bench.online();
  bench.command("{}");
  bench.broker.acknowledges = false;
  CommandResult result;
  result.arrival = bench.commands.at(0).arrival;
  bench.outbox.push(result);
  bench.settle();
  bench.broker.refuse_next(0x90);
  bench.settle();
  bench.advance(200ms);
  const auto lines = audit_lines(scratch.path("store"));
  EXPECT_EQ(lines.at(0)["acknowledged"], nullptr);
  EXPECT_EQ(lines[0]["refused_by_broker"], true);
}

TEST(PublisherAudit, OrderThatACrashLeftBehindGetsItsOutcomeAndItsAcknowledgement) {
  const test::Scratch scratch;
  {
    Bench bench(scratch.path("store"));
    bench.online();
    bench.command(R"({"id":"left","op":"write","tag":"setpoint","value":50})");
    OrderNote order = note("left");
    order.arrival = bench.commands.at(0).arrival;
    bench.outbox.push(order);
    bench.step();
  }  // no goodbye
  Bench again(scratch.path("store"));
  again.made();
  Recall known = recall(again.config, again.store.get(), again.utc(), again.now);
  // A write: the field reads what it was to write, and says.
  EXPECT_TRUE(known.untold.empty());
  ASSERT_EQ(known.field.left_behind.size(), 1U);
  const Command& command = known.field.left_behind[0];
  EXPECT_EQ(command.id, "left");
  EXPECT_EQ(command.targets.at(0).value, Value(std::int64_t{50}));
  EXPECT_EQ(command.received_ms, 1790000000000);
  EXPECT_EQ(command.response_topic, "hmi/replies");
  CommandResult result = test::succeeded("left");
  result.status = CommandStatus::unknown_outcome;
  result.arrival = command.arrival;
  again.outbox.push(result);
  again.settle();
  again.advance(1s);
  const auto lines = audit_lines(scratch.path("store"));
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_EQ(lines[0]["status"], "UNKNOWN_OUTCOME");
  EXPECT_EQ(lines[0]["records"], json::parse("[1,2,3]"));
  EXPECT_NE(lines[0]["acknowledged"], nullptr);
  again.store->close();
  Store store(again.config.store, again.utc());
  const Recall later = recall(again.config, &store, again.utc(), again.now);
  EXPECT_TRUE(later.field.left_behind.empty());
  EXPECT_EQ(later.field.results.at(0).result.status, CommandStatus::unknown_outcome);
}

TEST(PublisherAudit, HealthPublishesTheHeadOfTheChain) {
  const test::Scratch scratch;
  Bench bench(scratch.path("store"));
  bench.online();
  bench.command("{}");
  CommandResult result;
  result.arrival = bench.commands.at(0).arrival;
  bench.outbox.push(result);
  bench.settle();
  bench.advance(60s);
  const json health = json::parse(bench.broker.on(kBase + "/health").back());
  EXPECT_EQ(health["audit"]["records"], 2);
  EXPECT_EQ(health["audit"]["head"], audit::to_text(bench.store->audit_head().hash));
  Bench without;
  without.settle();
  EXPECT_EQ(json::parse(without.broker.on(kBase + "/health").at(0))["audit"], nullptr);
}

TEST(PublisherStore, NumbersAreReservedBeforeTheyAreUsed) {
  const test::Scratch scratch;
  std::uint64_t seq = 0;
  {
    Bench bench(scratch.path("store"));
    bench.made();
    seq = recall(bench.config, bench.store.get(), bench.utc(), bench.now).field.last_seq.at(0);
    for (int i = 0; i < 3000; ++i) {
      bench.outbox.push(test::sample(++seq));
      if (i % 100 == 0) bench.settle();
    }
    bench.settle();
  }
  Config config = test::plant();
  config.store.path = scratch.path("store");
  Store store(config.store, 0);
  EXPECT_GT(recall(config, &store, 0, kStart).field.last_seq.at(0), seq);
}

TEST(PublisherStore, RowsOfADeviceThatIsGoneStillArrive) {
  const test::Scratch scratch;
  {
    Bench bench(scratch.path("store"));
    bench.broker.reachable = false;
    bench.outbox.push(test::sample(1, 1));
    bench.settle();
    bench.advance(1s);
  }
  Bench again(scratch.path("store"));
  again.config.devices.pop_back();
  again.settle();
  EXPECT_EQ(seqs(again.broker.on(kBase + "/press2/data/fast/history")),
            std::vector<std::uint64_t>{1});
}

TEST(Publisher, BrokerThatAcknowledgesNothingForHalfAMinuteIsLeft) {
  Bench bench;
  bench.online();
  bench.advance(2min);  // nothing in flight: nothing to wait for
  EXPECT_EQ(bench.broker.connects.size(), 1U);
  bench.broker.acknowledges = false;
  bench.outbox.push(test::sample(1));
  bench.settle();
  bench.advance(29s);
  EXPECT_EQ(bench.broker.connects.size(), 1U);
  EXPECT_LE(bench.step(), bench.now + 1s);
  bench.broker.acknowledges = true;
  bench.advance(1s);
  bench.advance(2s);
  EXPECT_EQ(bench.broker.connects.size(), 2U);
  EXPECT_EQ(seqs(bench.broker.on(kBase + "/press1/data/fast/history")),
            std::vector<std::uint64_t>{1});
}

TEST(Publisher, ResultComesOnceAndAgainUntilItIsAcknowledged) {
  Bench bench;
  bench.online();
  bench.outbox.push(test::succeeded("a"));
  bench.settle();
  bench.advance(2h);
  EXPECT_EQ(bench.broker.on(kBase + "/press1/result").size(), 1U);

  bench.broker.acknowledges = false;
  bench.outbox.push(test::succeeded("b"));
  bench.settle();
  bench.broker.lose();
  bench.settle();
  bench.broker.acknowledges = true;
  bench.broker.log.clear();
  bench.advance(2s);
  const auto results = bench.broker.on(kBase + "/press1/result");
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(json::parse(results[0])["id"], "b");
  EXPECT_EQ(bench.broker.log.at(0).topic, kBase + "/press1/result");  // before the states
  EXPECT_EQ(bench.broker.log.at(0).retain, Retain::no);
}

TEST(Publisher, TotalEndsWhenTheResultIsFirstHandedOver) {
  Bench bench;
  bench.online();
  CommandResult result = test::succeeded("a");
  result.received = bench.now;
  bench.broker.lose();
  bench.settle();
  bench.outbox.push(result);
  bench.now += 700ms;
  bench.step();
  bench.advance(1300ms);
  const auto results = bench.broker.on(kBase + "/press1/result");
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(json::parse(results[0])["t"]["total_ms"], 2000);
}

TEST(Publisher, ResultGoesToTheResponseTopicTooWithItsCorrelation) {
  Bench bench;
  bench.online();
  CommandResult result = test::succeeded("a");
  result.response_topic = "hmi/replies";
  result.correlation = {1, 2, 3};
  bench.outbox.push(result);
  result.response_topic = kBase + "/press2/state";  // would forge a state
  bench.outbox.push(result);
  bench.settle();
  ASSERT_EQ(bench.broker.taken.size(), 3U);
  EXPECT_EQ(bench.broker.taken[0].topic, kBase + "/press1/result");
  EXPECT_EQ(bench.broker.taken[1].topic, "hmi/replies");
  EXPECT_EQ(bench.broker.taken[1].correlation, (Bytes{1, 2, 3}));
  EXPECT_EQ(bench.broker.taken[1].payload, bench.broker.taken[0].payload);
  EXPECT_EQ(bench.broker.taken[2].topic, kBase + "/press1/result");
}

TEST(Publisher, CommandReachesTheFieldWithItsTimes) {
  Bench bench;
  bench.online();
  Message message;
  message.topic = kBase + "/press2/command";
  message.payload = R"({"id":"a","op":"run"})";
  message.retained = true;
  message.response_topic = "r";
  message.correlation = {9};
  message.message_expiry = 5s;
  message.received = bench.now - 3ms;
  message.received_ms = 42;
  bench.broker.send(message);
  bench.step();
  ASSERT_EQ(bench.commands.size(), 1U);
  const Command& command = bench.commands[0];
  EXPECT_EQ(command.device, 1U);
  EXPECT_EQ(command.id, "a");
  EXPECT_TRUE(command.retained);
  EXPECT_EQ(command.response_topic, "r");
  EXPECT_EQ(command.correlation, Bytes{9});
  EXPECT_EQ(command.message_expiry, 5s);
  EXPECT_EQ(command.received, bench.now - 3ms);
  EXPECT_EQ(command.received_ms, 42);
}

TEST(Publisher, CommandForAnUnknownDeviceIsIgnored) {
  Bench bench;
  bench.online();
  bench.command(R"({"id":"a","op":"run"})", kBase + "/press9/command");
  bench.command(R"({"id":"a","op":"run"})", kBase + "/press1/x/command");
  EXPECT_TRUE(bench.commands.empty());
}

TEST(Publisher, EmptyRetainedPayloadOnlyClearsTheTopic) {
  Bench bench;
  bench.online();
  Message message;
  message.topic = kBase + "/press1/command";
  message.retained = true;
  bench.broker.send(message);
  bench.step();
  EXPECT_TRUE(bench.commands.empty());
  bench.command("");  // not retained, MQTT 5: an empty order is a bad one
  ASSERT_EQ(bench.commands.size(), 1U);
  EXPECT_EQ(bench.commands[0].refusal->reason, Reason::bad_json);
  bench.config.mqtt.version = 4;  // 3.1.1 does not tell us of the flag
  bench.command("");
  EXPECT_EQ(bench.commands.size(), 1U);
}

TEST(Publisher, RetainedTopicsOfUnknownDevicesAreCleared) {
  Bench bench;
  bench.settle();
  bench.broker.taken.clear();
  const auto retained = [&](const std::string& topic, const std::string& payload) {
    Message message;
    message.topic = topic;
    message.payload = payload;
    message.retained = true;
    bench.broker.send(message);
  };
  retained(kBase + "/press9/state", "{}");
  retained(kBase + "/press9/meta", "{}");
  retained(kBase + "/press8/meta", "");  // the clearing of it coming back
  retained(kBase + "/press1/state", "{}");
  bench.settle();
  ASSERT_EQ(bench.broker.taken.size(), 2U);
  for (const Publication& p : bench.broker.taken) {
    EXPECT_TRUE(p.topic == kBase + "/press9/state" || p.topic == kBase + "/press9/meta");
    EXPECT_EQ(p.payload, "");
    EXPECT_EQ(p.retain, Retain::yes);
  }
  EXPECT_EQ(bench.broker.filters.size(), 3U);
  bench.advance(10s);
  EXPECT_EQ(bench.broker.filters, std::set<std::string>{kBase + "/+/command"});
}

TEST(Publisher, ServersAreTriedFromTheTopWithGrowingPauses) {
  Bench bench;
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
    EXPECT_LE(pause, 38s);  // 30 s and a quarter
    if (round < 6) {
      EXPECT_GT(pause, last);
    }
    last = pause;
    EXPECT_EQ(bench.broker.connects.back(), 1U);
  }
}

TEST(Publisher, StaysOnItsServerUntilThatFailsAndStartsFromTheTopAgain) {
  Bench bench;
  bench.broker.reachable = false;
  bench.settle();
  bench.broker.reachable = true;
  bench.advance(2s);
  ASSERT_TRUE(bench.broker.up());
  bench.advance(1h);
  const std::size_t connects = bench.broker.connects.size();
  bench.broker.lose();
  bench.settle();
  bench.advance(2s);
  ASSERT_EQ(bench.broker.connects.size(), connects + 1);
  EXPECT_EQ(bench.broker.connects.back(), 0U);
}

TEST(Publisher, ServerThatDropsUsAtOnceIsNotTriedForEver) {
  Bench bench;
  bench.settle();
  bench.broker.lose();
  bench.settle();
  EXPECT_EQ(bench.broker.connects, (std::vector<std::size_t>{0, 1}));
}

TEST(Publisher, LibraryThatNeverAnswersIsGivenUp) {
  Bench bench;
  bench.broker.reachable = false;
  bench.broker.answers = false;
  bench.step();
  EXPECT_EQ(bench.broker.connects.size(), 1U);
  bench.advance(30s);
  EXPECT_EQ(bench.broker.connects.size(), 2U);
}

TEST(Publisher, SampleThatNoRepeatCanCureIsDroppedAndCounted) {
  Bench bench;
  bench.online();
  bench.broker.acknowledges = false;
  for (const int code : {0x90, 0x95, 0x99}) {
    bench.outbox.push(test::sample(static_cast<std::uint64_t>(code)));
    bench.settle();
    bench.broker.refuse_next(code);
    bench.settle();
  }
  EXPECT_EQ(bench.made().samples().dropped, 3U);
  EXPECT_EQ(bench.broker.open(), 0U);
}

TEST(Publisher, RefusedDeviceWaitsAndItsNeighbourDoesNot) {
  Bench bench;
  bench.online();
  bench.broker.acknowledges = false;
  for (const int code : {0x87, 0x97}) {
    bench.broker.log.clear();
    bench.outbox.push(test::sample(1, 0));
    bench.settle();
    bench.broker.refuse_next(code);
    bench.settle();
    EXPECT_EQ(bench.made().samples().dropped, 0U);
    bench.outbox.push(test::sample(2, 0));
    bench.outbox.push(test::sample(3, 1));
    bench.settle();
    EXPECT_EQ(seqs(bench.broker.on(kBase + "/press2/data/fast")), std::vector<std::uint64_t>{3});
    EXPECT_TRUE(bench.broker.on(kBase + "/press1/data/fast/history").empty());
    bench.broker.acknowledge_all();
    bench.advance(2s);
    EXPECT_EQ(seqs(bench.broker.on(kBase + "/press1/data/fast/history")),
              (std::vector<std::uint64_t>{1, 2}));
    bench.broker.acknowledge_all();
    bench.settle();
  }
  EXPECT_EQ(bench.made().samples().acknowledged, 6U);
}

TEST(Publisher, HealthNamesTheCodeOfARefusalUntilItIsOver) {
  Bench bench;
  bench.online();
  bench.broker.acknowledges = false;
  bench.outbox.push(test::sample(1, 0));
  bench.settle();
  bench.broker.refuse_next(0x97);
  bench.settle();
  const auto refused = [&] {
    bench.advance(60s);
    const json health = json::parse(bench.broker.on(kBase + "/health").back());
    EXPECT_EQ(health["devices"]["press2"]["refused"], nullptr);
    return health["devices"]["press1"]["refused"];
  };
  EXPECT_EQ(refused(), "0x97");
  bench.broker.acknowledges = true;
  bench.broker.acknowledge_all();
  bench.settle();
  EXPECT_EQ(refused(), nullptr);
}

TEST(Publisher, HistoryThatIsTooLargeIsCutInsteadOfDropped) {
  Bench bench;
  bench.broker.reachable = false;
  bench.broker.maximum_packet = 2000;
  for (std::uint64_t seq = 1; seq <= 100; ++seq) bench.outbox.push(test::sample(seq));
  bench.settle();
  bench.broker.reachable = true;
  bench.advance(40s);
  EXPECT_EQ(bench.made().samples().acknowledged, 100U);
  EXPECT_EQ(bench.made().samples().dropped, 0U);
  for (const Publication& p : bench.broker.taken) EXPECT_LE(p.payload.size(), 2000U);
}

TEST(Publisher, RefusedStateComesAgainWithItsNewestValue) {
  Bench bench;
  bench.online();
  bench.broker.acknowledges = false;
  bench.outbox.push(test::offline(0, "timeout"));
  bench.settle();
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

TEST(Publisher, HealthComesEveryMinuteAndBalances) {
  Bench bench;
  bench.online();
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

TEST(Publisher, StopPublishesWhatWaitsThenSaysStopped) {
  Bench bench;
  bench.online();
  bench.outbox.push(test::sample(1));
  bench.outbox.push(test::succeeded("a"));
  bench.made().stop(bench.now);
  bench.settle();
  EXPECT_TRUE(bench.made().finished());
  EXPECT_EQ(bench.broker.disconnects, 1);
  ASSERT_EQ(bench.broker.taken.size(), 3U);
  EXPECT_EQ(bench.broker.taken[0].topic, kBase + "/press1/result");
  EXPECT_EQ(bench.broker.taken[1].topic, kBase + "/press1/data/fast");
  EXPECT_EQ(bench.broker.taken[2].topic, kBase + "/state");
  const json state = json::parse(bench.broker.taken[2].payload);
  EXPECT_EQ(state["state"], "offline");
  EXPECT_EQ(state["reason"], "stopped");
  EXPECT_TRUE(state["since"].is_number());
}

TEST(Publisher, StopEndsInTimeWithABrokerThatDoesNotAnswer) {
  Bench bench;
  bench.online();
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

TEST(Publisher, StopWithoutABrokerEndsAtOnce) {
  Bench bench;
  bench.broker.reachable = false;
  bench.settle();
  bench.made().stop(bench.now);
  bench.settle();
  EXPECT_TRUE(bench.made().finished());
}

TEST(Publisher, CommandDuringTheEndIsAnswered) {
  Bench bench;
  bench.online();
  bench.broker.acknowledges = false;
  bench.made().stop(bench.now);
  bench.outbox.push(test::sample(1));
  bench.step();
  bench.command(R"({"id":"late","op":"run"})");
  EXPECT_TRUE(bench.commands.empty());
  const auto results = bench.broker.on(kBase + "/press1/result");
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(json::parse(results[0])["reason"], "shutting_down");
  EXPECT_EQ(json::parse(results[0])["id"], "late");
}

TEST(Publisher, ThreadEndsAfterACleanStop) {
  Bench bench;
  bench.outbox.push(test::sample(1));
  Publisher& publisher = bench.made();
  std::stop_source stop;
  std::thread thread([&] { run_uplink(publisher, bench.outbox, stop.get_token()); });
  stop.request_stop();
  thread.join();
  EXPECT_TRUE(publisher.finished());
}

// Whatever the broker does, in whatever order: every sample is in exactly one place at every step,
// the window is kept, and once the broker behaves again nothing is missing that was not counted.
enum class Keeping : std::uint8_t { memory, offline, always };
class PublisherProperty : public testing::TestWithParam<std::tuple<unsigned, Keeping>> {};

TEST_P(PublisherProperty, NothingIsLostWithoutBeingCounted) {
  const auto [seed, keeping] = GetParam();
  std::mt19937 random(seed);
  const auto below = [&](unsigned n) {
    return static_cast<unsigned>(std::uniform_int_distribution<unsigned>(0, n - 1)(random));
  };
  const test::Scratch scratch;
  Bench bench(keeping == Keeping::memory ? "" : scratch.path("store"));
  bench.config.store.sync_always = keeping == Keeping::always;
  bench.config.store.max_bytes = 20000;
  bench.settings.backlog_bytes = 20000;
  bench.settings.jitter_seed = seed;
  bench.broker.receive_maximum = 1 + below(30);
  bench.broker.acknowledges = false;
  const std::size_t window = std::min(20U, bench.broker.receive_maximum);
  std::uint64_t seq = 0;
  std::uint64_t suppressed = 0;
  std::set<std::string> ids;
  for (int i = 0; i < 3000; ++i) {
    switch (below(12)) {
      case 0:
      case 1:
      case 2:
        for (unsigned n = below(6); n > 0; --n)
          bench.outbox.push(test::sample(++seq, below(2), below(2)));
        break;
      case 3: {
        CommandResult result = test::succeeded("id" + std::to_string(i));
        ids.insert(result.id);
        if (below(2) == 0) result.response_topic = "hmi/replies";
        bench.outbox.push(std::move(result));
        break;
      }
      case 4:
        bench.outbox.push(test::offline(below(2), "timeout", i));
        break;
      case 5:
      case 6:
      case 7:
        for (unsigned n = below(25); n > 0 && bench.broker.open() > 0; --n)
          bench.broker.acknowledge_next();
        break;
      case 8:
        if (bench.broker.open() > 0 && below(2) == 0) {
          // 0x90 and its like drop results too, so they stay out of this test.
          const int codes[] = {0, 0x80, 0x87, 0x97};
          bench.broker.refuse_next(codes[below(4)]);
        }
        break;
      case 9:
        if (bench.broker.up() && below(8) == 0) bench.broker.lose();
        break;
      case 10:
        bench.broker.reachable = below(3) != 0;
        break;
      case 11: {
        suppressed += below(3);
        bench.outbox.push(test::counted(seq + suppressed, suppressed));
        break;
      }
      default:
        break;
    }
    bench.now += std::chrono::milliseconds(below(400));
    bench.step();
    ASSERT_LE(bench.broker.open(), window);
  }
  bench.broker.reachable = true;
  bench.broker.acknowledges = true;
  bench.broker.acknowledge_all();
  for (int i = 0; i < 200; ++i) bench.advance(1s);

  const fxagent::json::Samples samples = bench.made().samples();
  EXPECT_EQ(samples.queued + samples.in_flight + samples.stored, 0U);
  EXPECT_EQ(samples.acknowledged + samples.dropped, seq);
  std::set<std::uint64_t> arrived;
  std::set<std::string> answered;
  std::map<std::string, std::uint64_t> last_live;
  for (const Publication& p : bench.broker.taken) {
    if (p.topic.find("/data/") != std::string::npos) {
      for (const std::uint64_t each : seqs({p.payload})) arrived.insert(each);
      if (!p.topic.ends_with("/history")) {
        const std::uint64_t each = seqs({p.payload}).at(0);
        EXPECT_GT(each, last_live[p.topic]);
        last_live[p.topic] = each;
      }
    }
    if (p.topic.ends_with("/result")) answered.insert(json::parse(p.payload)["id"]);
    if (p.topic.ends_with("/health")) {
      const json s = json::parse(p.payload)["samples"];
      EXPECT_EQ(s["collected"].get<int>() + s["recovered"].get<int>(),
                s["suppressed"].get<int>() + s["queued"].get<int>() + s["in_flight"].get<int>() +
                    s["stored"].get<int>() + s["acknowledged"].get<int>() +
                    s["dropped"].get<int>());
    }
  }
  // A row may arrive after it had to make room; what did not arrive was counted in any case.
  EXPECT_GE(arrived.size(), samples.acknowledged);
  EXPECT_EQ(answered, ids);
}

INSTANTIATE_TEST_SUITE_P(Seeds, PublisherProperty,
                         testing::Combine(testing::Range(1U, 21U),
                                          testing::Values(Keeping::memory)));
INSTANTIATE_TEST_SUITE_P(SeedsWithAStore, PublisherProperty,
                         testing::Combine(testing::Range(21U, 27U),
                                          testing::Values(Keeping::offline, Keeping::always)));

}  // namespace
}  // namespace fxagent
