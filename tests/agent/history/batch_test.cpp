// Rows of messages: those of the contract's examples, and refusals.
#include "agent/history/batch.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace fxagent::history {
namespace {

using Json = nlohmann::json;

constexpr const char* kTopic = "fx/plant-a/edge7/press1/data/fast";
constexpr const char* kSample =
    R"({"ts": 1790000000123, "seq": 1790000048211, "boot": "9f3c21aa", "meta": "a41c0f5b7d2e9368",
        "span_ms": 24.9, "values": {"temp": 23.4, "running": true}})";

/// Returns the batch of one message.
Json batch_of(const std::string& topic, const std::string& payload) {
  Batch batch("fx/plant-a");
  batch.add({topic, payload});
  return Json::parse(batch.text());
}

std::string reason_of(const std::string& topic, const std::string& payload) {
  const Json batch = batch_of(topic, payload);
  return batch["refused"].size() == 1 ? batch["refused"][0]["reason"].get<std::string>() : "";
}

TEST(HistoryBatch, SampleBecomesOneRow) {
  const Json batch = batch_of(kTopic, kSample);
  EXPECT_TRUE(batch["refused"].empty());
  EXPECT_EQ(batch["samples"], Json::parse(R"([{"agent": "fx/plant-a/edge7", "device": "press1",
    "group_name": "fast", "history": false, "ts": 1790000000123, "seq": 1790000048211,
    "boot": "9f3c21aa", "meta": "a41c0f5b7d2e9368", "span_ms": 24.9,
    "values": {"temp": 23.4, "running": true}}])"));
}

TEST(HistoryBatch, HistoryBecomesARowForEachSample) {
  const std::string rows =
      std::string("{\"history\": true, \"rows\": [") + kSample + "," + kSample + "]}";
  const Json batch = batch_of(std::string(kTopic) + "/history", rows);
  ASSERT_EQ(batch["samples"].size(), 2U);
  EXPECT_EQ(batch["samples"][1]["history"], true);
  EXPECT_EQ(batch["samples"][1]["group_name"], "fast");
}

TEST(HistoryBatch, WrongRowOfAHistoryKeepsTheCorrectOnes) {
  const std::string rows = std::string("{\"rows\": [{}, ") + kSample + "]}";
  const Json batch = batch_of(std::string(kTopic) + "/history", rows);
  EXPECT_EQ(batch["samples"].size(), 1U);
  EXPECT_EQ(batch["refused"].size(), 1U);
}

TEST(HistoryBatch, HealthBecomesTheCountsOfDroppedAndWaitingSamples) {
  const Json batch =
      batch_of("fx/plant-a/edge7/health", R"({"ts": 1790000060000, "boot": "9f3c21aa",
    "samples": {"queued": 1, "in_flight": 2, "stored": 3},
    "devices": {"press1": {"dropped": 7}, "press2": {}}})");
  EXPECT_EQ(batch["health"], Json::parse(R"([{"agent": "fx/plant-a/edge7", "boot": "9f3c21aa",
    "ts": 1790000060000, "waiting": 6, "dropped": {"press1": 7}}])"));
}

TEST(HistoryBatch, UnknownKeysAreIgnored) {
  const std::string later =
      R"({"ts": 1, "seq": 2, "boot": "b", "meta": "m", "values": {}, "new": [{}]})";
  const Json batch = batch_of(kTopic, later);
  ASSERT_EQ(batch["samples"].size(), 1U);
  EXPECT_FALSE(batch["samples"][0].contains("new"));
}

TEST(HistoryBatch, AnythingElseIsRefusedWithAReason) {
  EXPECT_EQ(reason_of(kTopic, "{"), "the payload is not JSON");
  EXPECT_EQ(reason_of(kTopic, "\xff"), "the payload is not JSON");
  EXPECT_EQ(reason_of(kTopic, std::string(1'000'000, '[')), "the payload is not JSON");
  EXPECT_EQ(reason_of(kTopic, "7"), "a sample is no object");
  EXPECT_EQ(reason_of(kTopic, R"({"ts": -1})"), "ts is no time in ms");
  EXPECT_EQ(reason_of(kTopic, R"({"ts": 1, "seq": 18446744073709551615})"), "seq is no number");
  EXPECT_EQ(reason_of("fx/plant-b/edge7/press1/data/fast", kSample),
            "the topic is not below the root");
  EXPECT_EQ(reason_of("fx/plant-a/Edge7/press1/data/fast", kSample),
            "the topic has no valid name of an agent");
  EXPECT_EQ(reason_of("fx/plant-a/edge7/press1/data/fast/other", kSample),
            "the topic is not one of data");
  EXPECT_EQ(reason_of("fx/plant-a/edge7/press1/state", kSample), "the topic is not one of data");
}

TEST(HistoryBatch, RefusedPayloadIsKeptAsHex) {
  const Json batch = batch_of(kTopic, "{\x01");
  EXPECT_EQ(batch["refused"][0]["payload"], "7b01");
  EXPECT_EQ(batch["refused"][0]["bytes"], 2);
}

}  // namespace
}  // namespace fxagent::history
