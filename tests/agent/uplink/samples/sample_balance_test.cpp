// A sample that is lost or invented inside the agent is an error in the log and in health.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "agent/uplink/payload/json_payload.h"
#include "agent/uplink/publisher.h"
#include "tests/agent/uplink/fake_broker.h"
#include "tests/agent/uplink/plant.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using nlohmann::json;
using namespace std::chrono_literals;

constexpr std::int64_t kUtc = 1790000000000;

struct SampleBalance : testing::Test {
  SampleBalance() { settle(); }

  void settle() {
    for (int i = 0; i < 100; ++i) publisher_.step(now_);
  }
  /// Advances to the next health tick and returns the log output.
  std::string tick() {
    testing::internal::CaptureStderr();
    now_ += 60s;
    settle();
    return testing::internal::GetCapturedStderr();
  }
  json samples() const {
    return json::parse(broker_.on("fx/plant-a/edge7/health").back())["samples"];
  }

  test::Scratch scratch_;
  Config config_ = [this] {
    Config config = test::plant();
    config.store.path = scratch_.path("store");
    return config;
  }();
  Outbox outbox_{1000};
  test::FakeBroker broker_;
  SteadyTime now_ = SteadyTime(1h);
  Store store_{config_.store, kUtc};
  GuardedStore guarded_{store_, [this] { outbox_.notify(); }};
  JsonPayload payload_{config_, "9f3c21aa", "0.1.0"};
  Commands commands_{config_, [](AdmittedCommand) {}, &guarded_.journal()};
  Publisher publisher_{config_,
                       {.boot = "9f3c21aa", .version = "0.1.0"},
                       payload_,
                       outbox_,
                       broker_,
                       commands_,
                       [] { return kUtc; },
                       &guarded_};
};

TEST_F(SampleBalance, HoldsThroughALifeOfSamples) {
  for (std::uint64_t seq = 1; seq <= 10; ++seq) outbox_.push(test::sample(seq));
  outbox_.push(test::counted(12, 2));
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
  ASSERT_TRUE(store_.samples().append(rows, Store::Hold::no));
  const std::string log = tick();
  EXPECT_NE(log.find("error samples_unbalanced collected=0"), std::string::npos) << log;
  EXPECT_EQ(samples()["balanced"], false);
  // The error is logged again at each tick.
  EXPECT_NE(tick().find("error samples_unbalanced"), std::string::npos);
}

TEST_F(SampleBalance, FieldThatCountsOtherwiseIsAnErrorInLogAndHealth) {
  outbox_.push(test::sample(1));
  outbox_.push(test::counted(3, 1));
  const std::string log = tick();
  EXPECT_NE(log.find("error samples_miscounted field=2 outbox=1"), std::string::npos) << log;
  EXPECT_EQ(samples()["balanced"], false);
  outbox_.push(test::sample(2));
  outbox_.push(test::counted(3, 1));
  EXPECT_EQ(tick().find("samples_miscounted"), std::string::npos);
  EXPECT_EQ(samples()["balanced"], true);
}

}  // namespace
}  // namespace fxagent
