// A sample that is lost or invented inside the agent is an error in the log and in health.
#include <gtest/gtest.h>

#include "tests/agent/uplink/publisher_bench.h"

namespace fxagent {
namespace {

using nlohmann::json;
using namespace std::chrono_literals;

struct SampleBalance : test::OnStoredBench {
  SampleBalance() { settle(); }

  /// Like the bench's settle(), which would fail without a balance.
  void settle() {
    for (int i = 0; i < 100; ++i) bench.made().step(bench.now);
  }
  /// Advances to the next health tick and returns the log output.
  std::string tick() {
    testing::internal::CaptureStderr();
    bench.now += 60s;
    settle();
    return testing::internal::GetCapturedStderr();
  }
  json samples() const { return bench.last("/health")["samples"]; }
};

TEST_F(SampleBalance, HoldsThroughALifeOfSamples) {
  for (std::uint64_t seq = 1; seq <= 10; ++seq) bench.outbox.push(test::sample(seq));
  bench.outbox.push(test::counted(12, 2));
  settle();
  const std::string log = tick();
  EXPECT_EQ(log.find("error"), std::string::npos) << log;
  EXPECT_EQ(samples()["balanced"], true);
  EXPECT_EQ(samples()["acknowledged"], 10);
}

TEST_F(SampleBalance, SampleOutOfNowhereIsAnErrorInLogAndHealth) {
  std::vector<SampleRow> rows(1);
  rows[0].stream = {"press1", "fast"};
  rows[0].seq = 1;
  rows[0].content = "{}";
  ASSERT_TRUE(bench.store->samples().append(rows, Store::Hold::no));
  const std::string log = tick();
  EXPECT_NE(log.find("error samples_unbalanced collected=0"), std::string::npos) << log;
  EXPECT_EQ(samples()["balanced"], false);
  // The error is logged again at each tick.
  EXPECT_NE(tick().find("error samples_unbalanced"), std::string::npos);
}

TEST_F(SampleBalance, FieldThatCountsOtherwiseIsAnErrorInLogAndHealth) {
  bench.outbox.push(test::sample(1));
  bench.outbox.push(test::counted(3, 1));
  const std::string log = tick();
  EXPECT_NE(log.find("error samples_miscounted field=2 outbox=1"), std::string::npos) << log;
  EXPECT_EQ(samples()["balanced"], false);
  bench.outbox.push(test::sample(2));
  bench.outbox.push(test::counted(3, 1));
  EXPECT_EQ(tick().find("samples_miscounted"), std::string::npos);
  EXPECT_EQ(samples()["balanced"], true);
}

}  // namespace
}  // namespace fxagent
