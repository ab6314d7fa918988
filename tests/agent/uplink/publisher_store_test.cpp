// The publisher with a store: samples of an outage go to disk and are sent afterwards.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "agent/store/disk/sqlite.h"
#include "tests/agent/uplink/publisher_bench.h"
#include "tests/support/disk_limit.h"

namespace fxagent {
namespace {

using nlohmann::json;
using test::kBase;
using test::kStart;
using test::Seqs;
using test::seqs;
using Bench = test::PublisherBench;
using namespace std::chrono_literals;

using PublisherStoreOnlineTest = test::OnStoredBenchOnline;
using PublisherStoreTest = test::OnStoredBench;

TEST(PublisherStore, SamplesOfAnOutageOutliveTheProcess) {
  const test::Scratch scratch;
  {
    Bench bench(scratch.path("store"));
    bench.broker.reachable = false;
    bench.take_samples(1, 3);
    EXPECT_EQ(bench.made().samples().queued, 3U);  // gathered for one commit
    bench.advance(200ms);
    EXPECT_EQ(bench.made().samples().stored, 3U);
  }  // no goodbye
  Bench again(scratch.path("store"));
  again.report(test::sample(4));
  EXPECT_EQ(again.history(), (Seqs{1, 2, 3}));
  EXPECT_EQ(again.live(), Seqs{4});
  const SampleCounts samples = again.made().samples();
  EXPECT_EQ(samples.recovered, 3U);
  EXPECT_EQ(samples.acknowledged, 4U);
  EXPECT_EQ(samples.stored, 0U);
  const json health = json::parse(again.broker.on(kBase + "/health").at(0));
  EXPECT_EQ(health["store"]["state"], "disk");
  EXPECT_EQ(health["samples"]["balanced"], true);
}

TEST(PublisherStore, RowOfAnEarlierRunGoesOutAsItWouldHaveLive) {
  const test::Scratch scratch;
  std::string meta;
  {
    Bench bench(scratch.path("store"));
    bench.broker.reachable = false;
    bench.take_samples(2);
    bench.advance(200ms);
    EXPECT_EQ(bench.made().samples().stored, 1U);
    meta = fxagent::json::device_meta(bench.config.devices[0]).hash;
  }  // no goodbye
  // The next run has another boot, and the tag has another name and type.
  Bench again(scratch.path("store"));
  again.settings.boot = "ffffffff";
  again.config.devices[0].tags[test::temp] = test::tag("heat", "D100", DataType::float32);
  again.settle();
  EXPECT_EQ(again.broker.on(kBase + "/press1/data/fast/history"),
            std::vector<std::string>{R"({"history":true,"rows":[{"ts":1790000000002,"seq":2,)"
                                     R"("boot":"9f3c21aa","meta":")" +
                                     meta + R"(","values":{"temp":23.4}}]})"});
}

TEST_F(PublisherStoreOnlineTest, UnacknowledgedForASecondIsOnDiskAndStillInFlight) {
  bench.broker.acknowledges = false;
  bench.take_samples(1, 20);
  EXPECT_EQ(bench.made().samples().in_flight, 18U);
  EXPECT_LE(bench.step(), bench.now + 1s);
  bench.advance(1s);
  EXPECT_EQ(bench.made().samples().in_flight, 0U);
  EXPECT_EQ(bench.made().samples().stored, 20U);
  EXPECT_TRUE(bench.broker.on(kBase + "/press1/data/fast/history").empty());
  bench.acknowledge_all();
  EXPECT_EQ(bench.made().samples().acknowledged, 18U);
  EXPECT_EQ(bench.history(), (Seqs{19, 20}));
  bench.broker.acknowledge_all();
  bench.advance(1s);
  EXPECT_EQ(bench.made().samples().acknowledged, 20U);
  bench.store.reset();
  EXPECT_EQ(Bench(scratch.path("store")).made().samples().recovered, 0U);
}

TEST_F(PublisherStoreTest, SamplesInFlightGoToTheDiskWithYoungerOnesOfTheirStream) {
  bench.settings.jitter_seed = 1;  // the first reconnect is made at once
  bench.online();
  bench.broker.acknowledges = false;
  bench.report(test::sample(1, 1));  // of press2
  bench.take_samples(1, 20);         // 17 in flight, 3 waiting
  bench.write("w1");
  bench.outbox.push(bench.succeeded("w1"));  // the three become history
  bench.settle();
  bench.advance(200ms);
  ASSERT_EQ(bench.store->samples().rows(), 20U) << "none of press2";
  bench.broker.acknowledges = true;
  bench.lose_connection();
  bench.advance(2s);
  EXPECT_EQ(bench.broker.connects.size(), 2U);
  const auto arrived = bench.history();
  EXPECT_EQ(arrived.size(), 20U);
  EXPECT_TRUE(std::ranges::is_sorted(arrived)) << testing::PrintToString(arrived);
}

// Rows on disk leave before those in memory, so the older ones must be on disk first.
TEST_F(PublisherStoreTest, SamplesInFlightLeaveBeforeYoungerOnesEvenIfTheDiskIsFullThen) {
  bench.settings.jitter_seed = 1;  // the first reconnect is made at once
  bench.online();
  bench.broker.acknowledges = false;
  bench.take_samples(1, 20);  // 18 in flight, 2 waiting
  bench.write("w1");
  bench.outbox.push(bench.succeeded("w1"));  // the two become history
  bench.settle();
  bench.advance(200ms);
  bench.broker.acknowledges = true;
  const test::DiskLimit full(1000);
  bench.lose_connection();
  bench.advance(2s);
  const auto arrived = bench.history();
  EXPECT_EQ(arrived.size(), 20U);
  EXPECT_TRUE(std::ranges::is_sorted(arrived)) << testing::PrintToString(arrived);
}

TEST_F(PublisherStoreOnlineTest, SamplesOfOneFifthOfASecondGoToDiskTogether) {
  bench.broker.acknowledges = false;
  const SteadyTime first = bench.now;
  for (std::uint64_t seq = 1; seq <= 30; ++seq) {  // 18 in flight, 12 waiting
    bench.outbox.push(test::sample(seq));
    bench.step();
    bench.now += 10ms;
  }
  bench.now = first + 999ms;
  bench.step();
  EXPECT_EQ(bench.made().samples().stored, 0U);
  bench.now = first + 1s;
  bench.step();
  EXPECT_EQ(bench.store->samples().rows(), 18U);  // the rows of the first 200 ms, in flight
  bench.now = first + 1180ms;
  bench.step();
  EXPECT_EQ(bench.store->samples().rows(), 30U);
}

TEST_F(PublisherStoreOnlineTest, SampleInFlightWhenTheConnectionGoesIsOnDiskAtOnce) {
  bench.broker.acknowledges = false;
  bench.take_samples(1);
  EXPECT_EQ(bench.store->samples().rows(), 0U);
  bench.broker.lose();
  bench.step();
  EXPECT_EQ(bench.store->samples().rows(), 1U);
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

TEST_F(PublisherStoreTest, WithAlwaysEverySampleIsOnDiskBeforeItIsSent) {
  bench.config.store.sync_always = true;
  bench.online();
  bench.broker.acknowledges = false;
  bench.take_samples(1, 3);
  EXPECT_EQ(bench.live(), (Seqs{1, 2, 3}));
  EXPECT_EQ(bench.made().samples().stored, 3U);
  bench.broker.acknowledge_next();
  bench.settle();
  EXPECT_EQ(bench.made().samples().acknowledged, 1U);
  bench.advance(200ms);
  bench.store.reset();  // no goodbye
  Bench again(scratch.path("store"));
  again.settle();
  EXPECT_EQ(again.history(), (Seqs{2, 3}));
}

TEST_F(PublisherStoreTest, ReconnectInTheMiddleOfTheBacklogLosesAndReordersNothing) {
  bench.broker.reachable = false;
  bench.take_samples(1, 900);
  bench.advance(1s);
  bench.broker.reachable = true;
  bench.broker.acknowledges = false;
  while (!bench.broker.up()) bench.advance(1s);
  for (int i = 0; i < 5; ++i) {
    bench.broker.acknowledge_next();  // the states, then the first history message
    bench.settle();
  }
  ASSERT_LT(bench.made().samples().stored, 900U);
  ASSERT_GT(bench.made().samples().stored, 0U);
  ASSERT_GT(bench.broker.open(), 0U);
  bench.lose_connection();
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

TEST_F(PublisherStoreTest, HistoryHasAShareOfTheWindowAndLiveTheRest) {
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
  bench.acknowledge_all();
  bench.broker.log.clear();
  bench.take_samples(21);
  EXPECT_LE(bench.broker.open(), 3U);  // two history messages and the live one
  EXPECT_EQ(bench.live(), Seqs{21});
}

/// History streams of 900 rows each. The broker acknowledges only on request, and everything in
/// flight is history.
class Streams final {
 public:
  explicit Streams(std::uint32_t streams, int window = 20) : bench_(scratch_.path("store")) {
    bench_.broker.reachable = false;
    for (std::uint64_t seq = 1; seq <= 900; ++seq)
      for (std::uint32_t stream = 0; stream < streams; ++stream)
        bench_.outbox.push(test::sample(seq, stream / 2, stream % 2));
    bench_.settle();
    bench_.advance(1s);
    bench_.broker.reachable = true;
    bench_.broker.receive_maximum = static_cast<std::uint16_t>(window);
    bench_.broker.acknowledges = false;
    while (!bench_.broker.up()) bench_.advance(100ms);
    bench_.settle();
    while (sent().empty() || bench_.broker.open() > sent().size()) {  // the states come first
      if (bench_.broker.open() == 0) throw std::runtime_error("no history comes");
      bench_.broker.acknowledge_next();
      bench_.settle();
    }
  }

  Bench& operator*() { return bench_; }
  Bench* operator->() { return &bench_; }
  /// Returns all history messages so far.
  std::vector<Publication> sent() const {
    std::vector<Publication> out;
    for (const Publication& p : bench_.broker.log)
      if (p.topic.ends_with("/history")) out.push_back(p);
    return out;
  }

 private:
  test::Scratch scratch_;
  Bench bench_;
};

TEST(PublisherStore, TwoStreamsOfHistoryAreOnTheirWayAtATimeAndOneWhereTheWindowIsSmall) {
  for (const int window : {20, 5, 4, 2}) {
    Streams streams(4, window);
    streams->advance(500ms);
    const auto sent = streams.sent();
    ASSERT_EQ(sent.size(), window > 4 ? 2U : 1U) << window;
    EXPECT_NE(sent.front().topic, window > 4 ? sent.back().topic : "");
  }
}

TEST(PublisherStore, ShortMessageDoesNotCutTheRestOfALongOneShort) {
  Streams streams(2);
  const auto acknowledge_after = [&](std::chrono::milliseconds time) {
    streams->advance(time);
    streams->broker.acknowledge_next();
    streams->step();
  };
  acknowledge_after(100ms);  // of two sent together; the pause is 50 ms
  streams->advance(50ms);
  ASSERT_EQ(streams.sent().size(), 3U);
  acknowledge_after(10ms);  // the second took 160 ms: the pause is 80 ms
  acknowledge_after(2ms);   // the third took 12 ms
  streams->advance(77ms);
  EXPECT_EQ(streams.sent().size(), 3U);
  streams->advance(1ms);
  EXPECT_EQ(streams.sent().size(), 5U);
}

TEST(PublisherStore, TwoMessagesTooLargeHalveTheirSizeOnce) {
  Streams streams(2);
  const std::size_t first = streams.sent().front().payload.size();
  streams->broker.refuse_next(0x95);
  streams->broker.refuse_next(0x95);
  streams->settle();
  streams->advance(100ms);
  ASSERT_EQ(streams.sent().size(), 4U);
  EXPECT_GT(streams.sent().back().payload.size(), first / 3);
  EXPECT_LE(streams.sent().back().payload.size(), 16384U / 2);  // half of the limit
}

TEST(PublisherStore, StreamThatIsTakenDoesNotEndThePauseOfOneThatIsRefused) {
  Streams streams(2);
  streams->advance(10ms);
  streams->broker.refuse_next(0x87);
  streams->settle();
  streams->broker.acknowledge_next();
  streams->settle();
  streams->advance(400ms);
  EXPECT_EQ(streams.sent().size(), 2U) << "both are of one device";
}

TEST(PublisherStore, HistoryRestsHalfAsLongAsItsLastMessageTook) {
  for (const bool on_disk : {true, false}) {
    const test::Scratch scratch;
    Bench bench(on_disk ? scratch.path("store") : std::string());
    bench.broker.reachable = false;
    bench.take_samples(1, 900);
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
    EXPECT_EQ(bench.step(), bench.now + 5ms);
    bench.advance(4ms);
    EXPECT_EQ(messages(), 1U);
    bench.advance(1ms);
    ASSERT_EQ(messages(), 2U);
    // On a slow line the added pause stays short.
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
  bench.take_samples(1, 3);
  EXPECT_EQ(bench.store->state(), "memory");
  EXPECT_EQ(bench.made().samples().stored, 3U);
  std::filesystem::remove(scratch.path("store"));
  bench.advance(10s);
  EXPECT_EQ(bench.store->state(), "disk");
  EXPECT_EQ(bench.store->samples().rows(), 3U);
  EXPECT_EQ(bench.made().samples().stored, 3U);
  bench.outbox.push(test::sample(4));
  bench.advance(1s);
  bench.broker.reachable = true;
  bench.advance(40s);
  EXPECT_EQ(bench.history(), (Seqs{1, 2, 3, 4}));
}

TEST(PublisherStore, StopSaysHowManyCommandsTheDiskHasNotTaken) {
  for (const bool refuses : {true, false}) {
    const test::Scratch scratch;
    if (refuses) std::ofstream(scratch.path("store")) << "a file in its place";
    Bench bench(scratch.path("store"));
    bench.online();
    bench.write("b7e1");
    bench.write("b7e2");
    bench.report(bench.succeeded("b7e1"));
    bench.report(bench.succeeded("b7e2"));
    testing::internal::CaptureStderr();
    bench.stop_without_spinning(100);
    const std::string log = testing::internal::GetCapturedStderr();
    EXPECT_EQ(log.find("commands_not_recorded count=2 ") != log.npos, refuses) << log;
    EXPECT_EQ(log.find("commands_not_recorded") != log.npos, refuses) << log;
  }
}

TEST_F(PublisherStoreOnlineTest, CleanStopLeavesTheRestOnDisk) {
  bench.broker.acknowledges = false;
  for (std::uint64_t seq = 1; seq <= 30; ++seq) bench.outbox.push(test::sample(seq));
  bench.step();
  bench.made().stop(bench.now);
  while (!bench.made().finished()) bench.advance(500ms);
  bench.store.reset();
  Bench again(scratch.path("store"));
  again.settle();
  EXPECT_EQ(again.made().samples().recovered, 30U);
  EXPECT_EQ(again.history().size(), 30U);
}

TEST(PublisherStore, NumbersAreReservedBeforeTheyAreUsed) {
  const test::Scratch scratch;
  std::uint64_t seq = 0;
  {
    Bench bench(scratch.path("store"));
    bench.made();
    seq = first_numbers(bench.config, bench.store.get(), bench.utc()).at(0);
    for (int i = 0; i < 3000; ++i) {
      bench.outbox.push(test::sample(++seq));
      if (i % 100 == 0) bench.settle();
    }
    bench.settle();
  }
  Config config = test::plant();
  config.store.path = scratch.path("store");
  Store store(config.store, 0);
  EXPECT_GT(first_numbers(config, &store, 0).at(0), seq);
}

TEST(PublisherStore, RowsOfADeviceThatIsGoneStillArrive) {
  const test::Scratch scratch;
  {
    Bench bench(scratch.path("store"));
    bench.broker.reachable = false;
    bench.report(test::sample(1, 1));
    bench.advance(1s);
  }
  Bench again(scratch.path("store"));
  again.config.devices.pop_back();
  again.settle();
  EXPECT_EQ(again.history("press2"), Seqs{1});
}

}  // namespace
}  // namespace fxagent
