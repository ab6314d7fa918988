// Results that the broker refuses or acknowledges late.
#include "agent/uplink/commands/result_delivery.h"

#include <gtest/gtest.h>

#include "tests/agent/uplink/publisher_bench.h"

namespace fxagent {
namespace {

using test::kBase;
using Bench = test::PublisherBench;
using namespace std::chrono_literals;

constexpr int kQuotaExceeded = 0x97;  // no final refusal
const std::string kOwn = kBase + "/press1/result";
const std::string kResponse = kOwn + "/hmi";

void refuse(Bench& bench) {
  bench.broker.refuse_next(kQuotaExceeded);
  bench.settle();
}

/// The only message on its way is refused four times: it comes again after a pause that doubles.
/// `sent` counts its repetitions.
void expect_growing_pauses(Bench& bench, const std::function<std::size_t()>& sent) {
  std::size_t count = sent();
  for (const auto pause : {1000ms, 2000ms, 4000ms, 8000ms}) {
    SCOPED_TRACE("a pause of " + std::to_string(pause.count()) + " ms");
    refuse(bench);
    bench.advance(pause - 1ms);
    EXPECT_EQ(sent(), count);
    bench.advance(pause / 4 + 1ms);
    ASSERT_EQ(sent(), ++count);
  }
}

using ResultDeliveryOnlineTest = test::OnBenchOnline;
using ResultDeliveryTest = test::OnBench;
using SampleDeliveryOnlineTest = test::OnBenchOnline;
using RetainedStateOnlineTest = test::OnBenchOnline;

TEST_F(ResultDeliveryOnlineTest, RefusedResponseTopicIsGivenUpAtOnce) {
  bench.broker.acknowledges = false;
  CommandResult result = test::succeeded("a");
  result.response_topic = kResponse;
  bench.report(result);
  bench.broker.acknowledge_next();
  refuse(bench);
  bench.broker.acknowledges = true;
  bench.advance(1h);
  EXPECT_EQ(bench.broker.on(kOwn).size(), 1U);
  EXPECT_EQ(bench.broker.on(kResponse).size(), 1U);
}

TEST_F(ResultDeliveryOnlineTest, CommandForWhatNoDeviceCanBeIsAnsweredAndNotPublished) {
  for (const char* name : {"a b/c", "p1+", "Press1", "press9"}) {
    std::string answer;
    RelayedCommand command;
    command.device = name;
    command.payload = R"({"id":"a","op":"read","tag":"temp"})";
    command.reply = [&answer](const std::string& result) { answer = result; };
    bench.made().take_relayed(std::move(command), bench.now);
    bench.settle();
    EXPECT_NE(answer.find(R"("reason":"unknown_device")"), std::string::npos) << name << answer;
  }
  ASSERT_EQ(bench.broker.log.size(), 1U);
  EXPECT_EQ(bench.broker.log[0].topic, kBase + "/press9/result");
}

TEST_F(ResultDeliveryOnlineTest, CommandRefusedForLackOfRoomHasItsTimesAndIsCounted) {
  bench.broker.acknowledges = false;
  for (int i = 0; i < 200; ++i) bench.outbox.push(test::succeeded(std::to_string(i)));
  bench.settle();
  std::string answer;
  RelayedCommand command;
  command.device = "press1";
  command.payload = R"({"id":"a","op":"read","tag":"temp"})";
  command.reply = [&answer](const std::string& result) { answer = result; };
  bench.made().take_relayed(std::move(command), bench.now);
  const auto result = nlohmann::json::parse(answer);
  EXPECT_EQ(result["reason"], "queue_full");
  EXPECT_EQ(result["t"]["received"], bench.utc());
  EXPECT_EQ(result["t"]["total_ms"], 0);
  EXPECT_EQ(bench.commands->results().counts().at(CommandStatus::rejected), 1U);
  RelayedCommand without_reply;
  without_reply.device = "press1";
  bench.made().take_relayed(std::move(without_reply), bench.now);
  EXPECT_EQ(bench.commands->results().counts().at(CommandStatus::rejected), 2U);
}

TEST_F(ResultDeliveryOnlineTest, EveryWaitingResultGoesToItsResponseTopic) {
  bench.broker.acknowledges = false;
  for (const char* id : {"a", "b", "c"}) {
    CommandResult result = test::succeeded(id);
    result.response_topic = kResponse;
    bench.outbox.push(result);
  }
  bench.settle();
  EXPECT_EQ(bench.broker.on(kOwn).size(), 3U);
  EXPECT_EQ(bench.broker.on(kResponse).size(), 3U);
}

TEST_F(ResultDeliveryTest, ResponseTopicLongerThanAPacketGetsNothing) {
  bench.broker.maximum_packet = 2000;
  bench.online();
  CommandResult result = test::succeeded("a");
  result.response_topic = kOwn + "/" + std::string(1900, 't');
  bench.report(result);
  EXPECT_EQ(bench.broker.on(kOwn).size(), 1U);
  EXPECT_TRUE(bench.broker.on(result.response_topic).empty());
}

TEST_F(ResultDeliveryOnlineTest, PauseBetweenRefusalsGrows) {
  bench.broker.acknowledges = false;
  bench.report(test::succeeded("a"));
  expect_growing_pauses(bench, [&] { return bench.broker.on(kOwn).size(); });
}

TEST_F(ResultDeliveryOnlineTest, NewConnectionEndsThePauseAndTheNextOneIsShortAgain) {
  bench.broker.acknowledges = false;
  bench.report(test::succeeded("a"));
  refuse(bench);
  bench.advance(1250ms);
  refuse(bench);
  bench.advance(2500ms);
  ASSERT_EQ(bench.broker.on(kOwn).size(), 3U);
  refuse(bench);  // the next pause is 4 s or more
  bench.lose_connection();
  bench.advance(2s);
  ASSERT_TRUE(bench.broker.up());
  EXPECT_EQ(bench.broker.on(kOwn).size(), 4U) << "at once";
  refuse(bench);
  bench.advance(1250ms);
  EXPECT_EQ(bench.broker.on(kOwn).size(), 5U);
}

TEST_F(ResultDeliveryOnlineTest, EightMebibytesOfResultsHoldCommandsBack) {
  bench.broker.acknowledges = false;
  CommandResult large = test::succeeded("a");
  large.correlation = Bytes(65000, 1);
  const auto push = [&](int results) {
    for (int i = 0; i < results; ++i) bench.outbox.push(large);
    bench.settle();
  };
  push(100);
  EXPECT_FALSE(bench.broker.held);
  push(40);
  EXPECT_TRUE(bench.broker.held) << "140 results are fewer than their number allows";
  bench.broker.acknowledges = true;
  bench.acknowledge_all();
  EXPECT_FALSE(bench.broker.held);
}

TEST_F(RetainedStateOnlineTest, PauseBetweenRefusalsGrows) {
  bench.broker.acknowledges = false;
  bench.report(test::offline(0, "timeout"));
  expect_growing_pauses(bench, [&] { return bench.broker.on(kBase + "/press1/state").size(); });
}

TEST_F(RetainedStateOnlineTest, PauseGrowsThoughTheStateChanges) {
  bench.broker.acknowledges = false;
  const auto sent = [&] { return bench.broker.on(kBase + "/press1/state").size(); };
  bench.report(test::offline(0, "timeout"));
  refuse(bench);
  bench.report(test::offline(0, "link_down"));
  EXPECT_EQ(sent(), 2U) << "a change goes out at once";
  refuse(bench);
  bench.advance(1999ms);
  EXPECT_EQ(sent(), 2U);
  bench.advance(501ms);
  EXPECT_EQ(sent(), 3U);
}

TEST_F(SampleDeliveryOnlineTest, PauseBetweenRefusalsGrows) {
  bench.broker.acknowledges = false;
  bench.take_samples(1);
  expect_growing_pauses(
      bench, [&] { return bench.broker.on(kBase + "/press1/data/fast/history").size(); });
}

TEST(JitteredBackoff, AddsUpToAQuarterSoThatAgentsDoNotComeBackTogether) {
  std::set<std::chrono::milliseconds> pauses;
  for (std::uint32_t seed = 1; seed <= 20; ++seed) {
    const auto pause = JitteredBackoff(seed * 100'000'007U).after(0);  // small seeds begin alike
    EXPECT_GE(pause, 1000ms);
    EXPECT_LE(pause, 1250ms);
    pauses.insert(pause);
  }
  EXPECT_GT(pauses.size(), 1U);
}

}  // namespace
}  // namespace fxagent
