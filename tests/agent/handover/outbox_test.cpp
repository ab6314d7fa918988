#include "agent/handover/outbox.h"

#include <gtest/gtest.h>

#include <thread>

#include "tests/agent/uplink/plant.h"

namespace fxagent {
namespace {

TEST(Outbox, FullOutboxDropsTheOldestSampleAndNeverAResult) {
  Outbox outbox(2);
  for (std::uint64_t seq = 1; seq <= 5; ++seq) outbox.push(test::sample(seq, 1));
  for (const char* id : {"a", "b", "c"}) outbox.push(test::succeeded(id));
  for (int i = 0; i < 3; ++i) outbox.push(DeviceStatus{});
  const Outbox::Batch batch = outbox.take();
  ASSERT_EQ(batch.telemetry.size(), 2U);
  EXPECT_EQ(batch.telemetry[0].seq, 4U);
  EXPECT_EQ(batch.dropped.at(1), 3U);
  EXPECT_EQ(batch.results.size(), 3U);
  EXPECT_EQ(batch.states.size(), 3U);
  EXPECT_EQ(batch.pushed, 5U);
  EXPECT_TRUE(outbox.take().dropped.empty());
}

TEST(Outbox, HealthKnowsHowManySamplesWereBeforeIt) {
  Outbox outbox(10);
  outbox.push(test::sample(1));
  outbox.push(FieldHealth{});
  outbox.push(test::sample(2));
  const Outbox::Batch batch = outbox.take();
  EXPECT_TRUE(batch.health);
  EXPECT_EQ(batch.pushed_at_health, 1U);
  EXPECT_EQ(batch.pushed, 2U);
}

TEST(Outbox, WaitEndsWithNewsOrAtItsDeadline) {
  Outbox outbox(10);
  const auto never = SteadyTime::clock::now() + std::chrono::hours(1);
  outbox.push(test::sample(1));
  outbox.wait_until(never);  // already pushed
  std::thread pusher([&] { outbox.notify(); });
  outbox.wait_until(never);
  pusher.join();
  outbox.wait_until(SteadyTime::clock::now());  // nothing was pushed since
  EXPECT_EQ(outbox.take().telemetry.size(), 1U);
}

TEST(Outbox, OnlyTelemetryGathers) {
  Outbox outbox(10);
  const auto never = SteadyTime::clock::now() + std::chrono::hours(1);
  outbox.push(test::sample(1));
  outbox.gather(SteadyTime::clock::now() + std::chrono::milliseconds(1));
  std::thread pusher([&] {
    outbox.push(test::sample(2));
    outbox.push(test::succeeded("b7e1"));
  });
  outbox.gather(never);
  outbox.wait_until(never);  // samples wake it too
  pusher.join();
  const Outbox::Batch batch = outbox.take();
  EXPECT_EQ(batch.telemetry.size(), 2U);
  EXPECT_EQ(batch.results.size(), 1U);
}

TEST(Outbox, CallsComeWithWhatWasPushedBeforeThem) {
  Outbox outbox(10);
  int called = 0;
  outbox.push(CommandResult{});
  outbox.post([&](SteadyTime) { ++called; });
  const Outbox::Batch batch = outbox.take();
  EXPECT_EQ(batch.results.size(), 1U);
  ASSERT_EQ(batch.calls.size(), 1U);
  batch.calls[0]({});
  EXPECT_EQ(called, 1);
  EXPECT_TRUE(outbox.take().calls.empty());
}

}  // namespace
}  // namespace fxagent
