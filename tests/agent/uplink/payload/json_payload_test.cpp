#include "agent/uplink/payload/json_payload.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "tests/agent/uplink/plant.h"
#include "tests/agent/uplink/sample_text.h"

namespace fxagent {
namespace {

using nlohmann::json;
using test::good;
using namespace std::chrono_literals;

std::string telemetry_text(const Telemetry& message) {
  return json::parse(test::sample_text(message)).dump();
}

/// Returns the text of one value in the message.
std::string value_text(std::uint32_t tag, Value value) {
  Telemetry message = test::sample(1);
  message.readings = {good(tag, std::move(value))};
  const std::string text = test::sample_text(message);
  EXPECT_TRUE(json::accept(text)) << text;
  const std::string before = "\"values\":{\"" + test::press("press1").tags[tag].name + "\":";
  const std::size_t at = text.find(before) + before.size();
  return text.substr(at, text.size() - at - 2);
}

TEST(TelemetryJson, IsTheContractsExample) {
  Telemetry message = test::sample(48211);
  message.ts_ms = 1790000000123;
  message.span_ms = 149.0;
  TagReading pressure;
  pressure.tag = test::pressure;
  pressure.bad = BadReason::timeout;
  pressure.value = Value(5.1);
  pressure.bad_since_ms = 1789999998000;
  pressure.last_ms = 1789999997000;
  message.readings = {good(test::temp, Value(23.4)), pressure, good(test::running, Value(true))};
  EXPECT_EQ(json::parse(telemetry_text(message)), json::parse(R"({
    "ts": 1790000000123, "seq": 48211, "boot": "9f3c21aa", "meta": "a41c", "span_ms": 149.0,
    "values": {"temp": 23.4, "running": true},
    "bad": {"pressure": {"why": "timeout", "since": 1789999998000, "last": 5.1,
                         "last_ts": 1789999997000}}})"));
}

TEST(TelemetryJson, BadIsThereOnlyWhenSomethingIsBad) {
  EXPECT_FALSE(json::parse(telemetry_text(test::sample(1))).contains("bad"));
}

TEST(TelemetryJson, TagThatWasNeverReadHasNoLast) {
  Telemetry message = test::sample(1);
  message.readings[0].bad = BadReason::link_down;
  message.readings[0].value = Value();
  message.readings[0].bad_since_ms = 5;
  const json parsed = json::parse(telemetry_text(message));
  EXPECT_EQ(parsed["bad"]["temp"],
            json::parse(R"({"why":"link_down","since":5,"last":null,"last_ts":null})"));
  EXPECT_TRUE(parsed["values"].is_object() && parsed["values"].empty());
}

TEST(TelemetryJson, NumbersAreTheShortestThatReadBack) {
  EXPECT_EQ(value_text(test::temp, Value(23.4)), "23.4");
  EXPECT_EQ(value_text(test::temp, Value(0.1 + 0.2)), "0.30000000000000004");
  EXPECT_EQ(value_text(test::temp, Value(1e300)), "1e+300");
  EXPECT_EQ(value_text(test::temp, Value(-0.5)), "-0.5");
}

TEST(TelemetryJson, FloatOfThePlcHasNoDigitsThatItNeverHad) {
  EXPECT_EQ(value_text(test::level, Value(static_cast<double>(5.1F))), "5.1");
}

TEST(TelemetryJson, ScaledFloatHasAllItsDigits) {
  DeviceConfig press = test::press("press1");
  press.tags[test::level].point.scale = 0.1;
  const double scaled = static_cast<double>(5.1F) * 0.1;
  Telemetry message = test::sample(1);
  message.readings = {good(test::level, Value(scaled))};
  const std::string row = encode_sample(message, press, "9f3c21aa", "a41c");
  SampleRecord record;  // points into the row
  ASSERT_TRUE(decode_sample(row, record));
  EXPECT_EQ(json::parse(fxagent::json::sample(record))["values"]["level"], scaled);
}

TEST(TelemetryJson, IntegersStayIntegersAndLargeOnesBecomeStrings) {
  EXPECT_EQ(value_text(test::setpoint, Value(std::int64_t{-7})), "-7");
  EXPECT_EQ(value_text(test::setpoint, Value(std::int64_t{9007199254740992})), "9007199254740992");
  EXPECT_EQ(value_text(test::setpoint, Value(std::int64_t{9007199254740993})),
            "\"9007199254740993\"");
  EXPECT_EQ(value_text(test::setpoint, Value(std::int64_t{-9007199254740993})),
            "\"-9007199254740993\"");
  EXPECT_EQ(value_text(test::setpoint, Value(BigInteger{"18446744073709551615"})),
            "\"18446744073709551615\"");
}

TEST(TelemetryJson, TextIsEscapedAndAlwaysUtf8) {
  EXPECT_EQ(value_text(test::label, Value(std::string("a\"b\\c\n\x01°"))),
            "\"a\\\"b\\\\c\\n\\u0001°\"");
  EXPECT_EQ(value_text(test::label, Value(std::string("\xC3(\xFF"))),
            "\"\xEF\xBF\xBD(\xEF\xBF\xBD\"");
  EXPECT_EQ(value_text(test::label, Value(std::string("\xED\xA0\x80"))),  // a surrogate
            "\"\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD\"");
}

TEST(TelemetryJson, ArrayIsOneValue) {
  EXPECT_EQ(value_text(test::setpoint, Value::array({std::int64_t{1}, true, 2.5})), "[1,true,2.5]");
  EXPECT_EQ(value_text(test::setpoint, Value::array({})), "[]");
}

TEST(TelemetryJson, NanIsBadAndNeverANumber) {
  for (const double value : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    Telemetry message = test::sample(1);
    message.readings = {good(test::temp, Value(value)),
                        good(test::level, Value::array({1.0, value}))};
    const json parsed = json::parse(telemetry_text(message));
    EXPECT_TRUE(parsed["values"].empty());
    EXPECT_EQ(parsed["bad"]["temp"]["why"], "bad_value");
    EXPECT_EQ(parsed["bad"]["level"]["last"], nullptr);
  }
}

TEST(TelemetryJson, WrittenTagIsNamedWhereNothingWasReadBack) {
  Telemetry message = test::sample(1);
  message.partial = true;
  message.readings = {good(test::setpoint, Value(std::int64_t{50}))};
  EXPECT_FALSE(json::parse(telemetry_text(message)).contains("written"));
  message.written = true;
  const json parsed = json::parse(telemetry_text(message));
  EXPECT_EQ(parsed["partial"], true);
  EXPECT_EQ(parsed["written"], json::parse(R"(["setpoint"])"));
}

TEST(StateJson, IsTheContractsExamples) {
  const Config config = test::plant();
  const JsonPayload payload(config, "9f3c21aa", "0.1.0");
  EXPECT_EQ(payload.agent_online(1790000000000, std::nullopt, std::nullopt).payload,
            R"({"state":"online","since":1790000000000,"boot":"9f3c21aa","version":"0.1.0"})");
  EXPECT_EQ(
      payload.agent_online(7, "Not authorized", std::nullopt).payload,
      R"({"state":"online","since":7,"boot":"9f3c21aa","version":"0.1.0","commands":false,"reason":"Not authorized"})");
  EXPECT_EQ(payload.last_will().payload,
            R"({"state":"offline","since":null,"reason":"lost","boot":"9f3c21aa"})");
  EXPECT_EQ(payload.agent_offline(7).payload,
            R"({"state":"offline","since":7,"reason":"stopped","boot":"9f3c21aa"})");
  DeviceStatus status = test::status_of(0, DeviceStatus::State::online);
  status.since_ms = 7;
  status.model = "FX3U";
  status.run = true;
  EXPECT_EQ(
      payload.device_state(status).payload,
      R"({"state":"online","since":7,"reason":null,"reason_text":null,"model":"FX3U","model_configured":null,"run":true})");
  EXPECT_EQ(
      payload.device_state(test::offline(0, "timeout")).payload,
      R"({"state":"offline","since":7,"reason":"timeout","reason_text":null,"model":null,"model_configured":null,"run":null})");
  DeviceStatus other = test::offline(0, "timeout");
  other.reason_text = "has it power?";
  other.model = "FX2N";
  other.model_configured = "FX3U";
  EXPECT_EQ(
      payload.device_state(other).payload,
      R"({"state":"offline","since":7,"reason":"timeout","reason_text":"has it power?","model":"FX2N","model_configured":"FX3U","run":null})");
}

TEST(MetaJson, DescribesEveryTag) {
  const fxagent::json::Meta meta = fxagent::json::device_meta(test::press("press1"));
  const json parsed = json::parse(meta.text);
  EXPECT_EQ(parsed["hash"], meta.hash);
  EXPECT_EQ(parsed["tags"]["temp"], json::parse(R"({"address":"D100","type":"int16","unit":"°C",
      "scale":0.1,"offset":0,"group":"fast","access":"read","deadband":0.5})"));
  EXPECT_EQ(parsed["tags"]["setpoint"]["access"], "read_write");
  EXPECT_EQ(parsed["tags"]["setpoint"]["max"], 1000);
  EXPECT_EQ(parsed["tags"]["label"]["length"], 8);
  // From sha256sum over the tags as in the message.
  EXPECT_EQ(meta.hash, "1603d6eb262f80b0");
}

TEST(MetaJson, HashChangesWithTheTagsAndOnlyThen) {
  DeviceConfig device = test::press("press1");
  const std::string hash = fxagent::json::device_meta(device).hash;
  EXPECT_EQ(fxagent::json::device_meta(test::press("press2")).hash, hash);
  device.tags[0].point.offset = 1;
  EXPECT_NE(fxagent::json::device_meta(device).hash, hash);
}

TEST(MetaJson, HasDescriptionAndStatesWhereTheyAreSet) {
  DeviceConfig device = test::press("press1");
  TagUnits units = *device.tags[0].units;
  const auto meta_with = [&] {
    device.tags[0].units = std::make_shared<const TagUnits>(units);
    return fxagent::json::device_meta(device);
  };
  const std::string plain = meta_with().hash;
  units.description = "Oil, \"left\"";
  const std::string described = meta_with().hash;
  units.states = {{-1, "no sensor"}, {0, "cold"}};
  const auto whole = meta_with();
  const json tag = json::parse(whole.text)["tags"]["temp"];
  EXPECT_EQ(tag["description"], "Oil, \"left\"");
  EXPECT_EQ(tag["states"], json::parse(R"({"-1": "no sensor", "0": "cold"})"));
  EXPECT_EQ((std::set<std::string>{plain, described, whole.hash}).size(), 3U);
}

TEST(HealthJson, HasEveryCounterByName) {
  AgentStatus health;
  health.samples.collected = 3;
  health.samples.acknowledged = 3;
  FieldHealth field = test::counted(0, 0);
  field.links.resize(1);
  field.links[0].exchanges = 9;
  field.links[0].turnaround_ms.p50 = 1.5;
  health.field = std::make_shared<const FieldHealth>(std::move(field));
  health.dropped = {0, 5};
  health.commands[CommandStatus::unknown_outcome] = 2;
  health.commands[CommandStatus::partial] = 3;
  health.store_state = "memory";
  const json parsed = json::parse(fxagent::json::health(health, test::plant()));
  for (const char* key : {"collected", "recovered", "suppressed", "queued", "in_flight", "stored",
                          "acknowledged", "dropped", "published"})
    EXPECT_TRUE(parsed["samples"].contains(key)) << key;
  EXPECT_EQ(parsed["links"]["line1"]["exchanges"], 9);
  EXPECT_EQ(parsed["links"]["line1"]["turnaround_ms"]["p50"], 1.5);
  EXPECT_EQ(parsed["devices"]["press1"]["polls"], 9);
  EXPECT_EQ(parsed["devices"]["press2"]["dropped"], 5);
  EXPECT_EQ(parsed["commands"]["UNKNOWN_OUTCOME"], 2);
  EXPECT_EQ(parsed["commands"]["SUCCEEDED"], 0);
  EXPECT_EQ(parsed["commands"]["PARTIAL"], 3);
  EXPECT_EQ(parsed["store"]["hours_left"], nullptr);
  EXPECT_TRUE(parsed.contains("clock_synchronised") && parsed.contains("rss_bytes") &&
              parsed.contains("uptime_s"));
}

std::string text_of(SampleHistory& history) {
  return history.take({"press1", "fast"}).at(0).payload;
}

TEST(JsonPayload, HistoryHoldsRowsAsTheyWere) {
  const Config config = test::plant();
  JsonPayload payload(config, "9f3c21aa", "0.1.0");
  const auto history = payload.begin_history(1000);
  SampleRecord one;
  SampleRecord two;
  two.seq = 2;
  ASSERT_TRUE(history->add(one) && history->add(two));
  EXPECT_EQ(text_of(*history), R"({"history":true,"rows":[)" + fxagent::json::sample(one) + "," +
                                   fxagent::json::sample(two) + "]}");
  EXPECT_EQ(text_of(*payload.begin_history(0)), R"({"history":true,"rows":[]})");
}

TEST(JsonPayload, HistoryKeepsItsSizeAndALargerRowGoesAlone) {
  const Config config = test::plant();
  JsonPayload payload(config, "9f3c21aa", "0.1.0");
  const SampleRecord row;
  const std::size_t two_rows = 26 + 2 * fxagent::json::sample(row).size() + 1;
  const auto history = payload.begin_history(two_rows);
  EXPECT_TRUE(history->add(row) && history->add(row));
  EXPECT_FALSE(history->add(row));
  EXPECT_EQ(text_of(*history).size(), two_rows);
  EXPECT_TRUE(payload.begin_history(1)->add(row));
}

TEST(JsonPayload, HistoryOfARecordIsItsLiveText) {
  Telemetry message = test::sample(7);
  message.partial = message.written = true;
  const std::string row = encode_sample(message, test::press("press1"), "9f3c21aa", "a41c");
  SampleRecord record;
  ASSERT_TRUE(decode_sample(row, record));
  const Config config = test::plant();
  JsonPayload payload(config, "another", "0.1.0");
  const auto history = payload.begin_history(1000);
  ASSERT_TRUE(history->add(record));
  const Publication live = payload.sample({"press1", "fast"}, record).at(0);
  EXPECT_EQ(text_of(*history), R"({"history":true,"rows":[)" + live.payload + "]}");
  EXPECT_EQ(live.payload,
            R"({"ts":1790000000007,"seq":7,"boot":"9f3c21aa","meta":"a41c","partial":true,)"
            R"("values":{"temp":23.4},"written":["temp"]})");
}

TEST(JsonPayload, TopicsAndTheirDeliveryAreTheContracts) {
  Config config = test::plant();
  config.mqtt.qos = 0;
  JsonPayload payload(config, "9f3c21aa", "0.1.0");
  const auto place = [](const Publication& made) {
    return made.topic + (made.retain == Retain::yes ? " retained " : " ") +
           std::to_string(made.qos);
  };
  const std::string base = "fx/plant-a/edge7";
  EXPECT_EQ(place(payload.agent_online(7, std::nullopt, std::nullopt)), base + "/state retained 1");
  EXPECT_EQ(place(payload.agent_offline(7)), base + "/state retained 1");
  EXPECT_EQ(place(payload.device_state(test::offline(1, "timeout"))),
            base + "/press2/state retained 1");
  EXPECT_EQ(place(payload.device_meta(1)), base + "/press2/meta retained 1");
  EXPECT_EQ(place(payload.sample({"press1", "fast"}, {}).at(0)), base + "/press1/data/fast 0");
  EXPECT_EQ(place(payload.begin_history(1)->take({"press1", "fast"}).at(0)),
            base + "/press1/data/fast/history 0");
  const Publication will = payload.last_will();
  EXPECT_EQ(will.topic, base + "/state");
  EXPECT_EQ(will.payload, R"({"state":"offline","since":null,"reason":"lost","boot":"9f3c21aa"})");
  EXPECT_EQ(will.retain, Retain::yes);
}

}  // namespace
}  // namespace fxagent
