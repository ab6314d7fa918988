// The publisher on a disk that hangs: it continues or refuses each operation, and loses or
// double-counts nothing when the disk works again.
#include <gtest/gtest.h>

#include "tests/agent/store/power_cut.h"
#include "tests/agent/uplink/publisher_bench.h"

namespace fxagent {
namespace {

using nlohmann::json;
using test::kBase;
using test::Seqs;
using Bench = test::PublisherBench;
using namespace std::chrono_literals;

struct PublisherHang : ::testing::Test {
  void freeze() {
    frost.emplace(disk);
    bench.guarded->set_patience(1ms);
  }
  /// Returns when the store hangs in a write. Nothing changes afterwards until thaw().
  void await_hang() {
    while (!disk.is_awaited() || bench.guarded->state() != "hangs") bench.step();
  }
  /// The disk works again, which wakes the uplink; it continues.
  void thaw() {
    bench.guarded->set_patience(1h);
    frost.reset();
    while (bench.guarded->state() == "hangs") {
      bench.outbox.wait_until(std::chrono::steady_clock::now() + 10s);
      bench.step();
    }
    bench.settle();
  }
  json health() {
    bench.advance(60s);
    return bench.last("/health");
  }
  test::PowerCut disk;
  test::Scratch scratch;
  Bench bench{scratch.path("store")};
  std::optional<test::Frost> frost;  ///< destroyed before the store
};

TEST_F(PublisherHang, LiveSamplesAndAnswersGoOnAndCommandsThatWriteAreRefused) {
  bench.online();
  freeze();
  bench.write("one");
  bench.write("two");
  ASSERT_EQ(bench.results().size(), 2U);
  for (const json& result : bench.results()) {
    EXPECT_EQ(result["status"], "REJECTED");
    EXPECT_EQ(result["reason"], "store_unavailable");
  }
  for (std::uint64_t seq = 1; seq <= 3; ++seq) bench.outbox.push(test::sample(seq));
  bench.outbox.push(test::offline(1, "timeout"));
  bench.settle();
  EXPECT_EQ(bench.live(), (Seqs{1, 2, 3}));
  EXPECT_FALSE(bench.broker.on(kBase + "/press2/state").empty());
  EXPECT_EQ(health()["store"]["state"], "hangs");
  // Commands without a journal entry get their results as usual.
  bench.command(R"({"id":"dry","op":"write","tag":"setpoint","value":5,"dry_run":true})");
  bench.command(R"({"id":"wrong","op":"write","tag":"none","value":5})");
  bench.command(R"({"id":"look","op":"read","tag":"setpoint"})");
  ASSERT_EQ(bench.admitted.size(), 1U);
  EXPECT_EQ(bench.admitted[0].command.id, "look");
  bench.report(bench.succeeded("look"));
  ASSERT_EQ(bench.results().size(), 5U);
  EXPECT_EQ(bench.results()[2]["status"], "SUCCEEDED");
  EXPECT_EQ(bench.results()[3]["reason"], "unknown_tag");
  EXPECT_EQ(bench.results()[4]["id"], "look");

  thaw();
  EXPECT_EQ(bench.admitted.size(), 1U) << "what was refused is never carried out";
  EXPECT_EQ(bench.results().size(), 5U) << "each has one result";
  EXPECT_EQ(health()["store"]["state"], "disk");
  bench.write("one");
  EXPECT_EQ(bench.results().back()["status"], "DUPLICATE");
  EXPECT_EQ(bench.results().back()["first"]["reason"], "store_unavailable");
  bench.write("three");
  EXPECT_EQ(bench.admitted.back().command.id, "three");
}

TEST_F(PublisherHang, RestartMakesNoSecondResultOfWhatWasRefused) {
  bench.online();
  freeze();
  bench.write("one");
  bench.write("two");
  thaw();
  bench.advance(1s);
  bench.store.reset();  // no goodbye
  Bench again(scratch.path("store"));
  again.online();
  EXPECT_TRUE(again.results().empty());
  again.write("one");
  again.write("two");
  ASSERT_EQ(again.results().size(), 2U);
  for (const json& result : again.results()) {
    EXPECT_EQ(result["status"], "DUPLICATE");
    EXPECT_EQ(result["first"]["reason"], "store_unavailable");
  }
}

TEST_F(PublisherHang, SamplesOfAnOutageArriveOnceAndInTheirOrder) {
  bench.broker.reachable = false;
  bench.settle();
  freeze();
  bench.take_samples(1, 3);
  bench.advance(200ms);
  await_hang();
  bench.take_samples(4, 5);
  bench.advance(200ms);
  bench.broker.reachable = true;
  for (int i = 0; i < 60; ++i) bench.advance(1s);
  ASSERT_TRUE(bench.broker.up());
  thaw();
  bench.advance(1s);
  EXPECT_EQ(bench.history(), (Seqs{1, 2, 3, 4, 5}));
  EXPECT_EQ(bench.made().samples().acknowledged, 5U);
  EXPECT_EQ(bench.made().samples().dropped, 0U);
}

TEST_F(PublisherHang, SamplesInFlightAreAcknowledgedOnce) {
  bench.online();
  bench.broker.acknowledges = false;
  bench.take_samples(1);
  bench.advance(1s);
  ASSERT_EQ(bench.made().samples().stored, 1U) << "in flight and on disk";
  freeze();
  bench.take_samples(2);
  bench.advance(1s);
  await_hang();  // needs the disk
  EXPECT_EQ(bench.made().samples().in_flight, 1U);
  bench.acknowledge_all();
  EXPECT_EQ(bench.made().samples().acknowledged, 1U) << "the other one is on disk still";
  EXPECT_EQ(bench.made().samples().stored, 1U);
  thaw();
  bench.advance(1s);
  EXPECT_EQ(bench.made().samples().acknowledged, 2U);
  EXPECT_EQ(bench.made().samples().stored, 0U);
  bench.store.reset();
  EXPECT_EQ(Bench(scratch.path("store")).made().samples().recovered, 0U);
}

}  // namespace
}  // namespace fxagent
