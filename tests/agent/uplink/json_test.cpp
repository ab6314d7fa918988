#include "agent/uplink/json.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "tests/agent/uplink/plant.h"

namespace fxagent {
namespace {

using nlohmann::json;
using test::good;
using namespace std::chrono_literals;

std::string telemetry_text(const Telemetry& message) {
  return json::parse(fxagent::json::telemetry(message, test::press("press1"), "9f3c21aa", "a41c"))
      .dump();
}

/// The text of one value as it stands in the message.
std::string value_text(std::uint32_t tag, Value value) {
  Telemetry message = test::sample(1);
  message.readings = {good(tag, std::move(value))};
  const std::string text =
      fxagent::json::telemetry(message, test::press("press1"), "9f3c21aa", "a41c");
  EXPECT_TRUE(json::accept(text)) << text;
  const std::string before = "\"values\":{\"" + test::press("press1").tags[tag].name.get() + "\":";
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

TEST(TelemetryJson, IntegersStayIntegersAndLargeOnesBecomeStrings) {
  EXPECT_EQ(value_text(test::setpoint, Value(std::int64_t{-7})), "-7");
  EXPECT_EQ(value_text(test::setpoint, Value(std::int64_t{9007199254740992})), "9007199254740992");
  EXPECT_EQ(value_text(test::setpoint, Value(std::int64_t{9007199254740993})),
            "\"9007199254740993\"");
  EXPECT_EQ(value_text(test::setpoint, Value(std::int64_t{-9007199254740993})),
            "\"-9007199254740993\"");
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

TEST(HistoryJson, HoldsRowsAsTheyWere) {
  EXPECT_EQ(fxagent::json::history(std::vector<std::string_view>{"{\"a\":1}", "{}"}),
            R"({"history":true,"rows":[{"a":1},{}]})");
  EXPECT_EQ(fxagent::json::history({}).size(), fxagent::json::kHistoryFrameBytes);
}

TEST(StateJson, IsTheContractsExamples) {
  EXPECT_EQ(fxagent::json::agent_online(1790000000000, "9f3c21aa", "0.1.0"),
            R"({"state":"online","since":1790000000000,"boot":"9f3c21aa","version":"0.1.0"})");
  EXPECT_EQ(
      fxagent::json::agent_online(7, "9f3c21aa", "0.1.0", "Not authorized"),
      R"({"state":"online","since":7,"boot":"9f3c21aa","version":"0.1.0","commands":false,"reason":"Not authorized"})");
  EXPECT_EQ(fxagent::json::agent_offline(std::nullopt, "lost", "9f3c21aa"),
            R"({"state":"offline","since":null,"reason":"lost","boot":"9f3c21aa"})");
  EXPECT_EQ(fxagent::json::agent_offline(7, "stopped", "9f3c21aa"),
            R"({"state":"offline","since":7,"reason":"stopped","boot":"9f3c21aa"})");
  DeviceStatus status;
  status.state = DeviceStatus::State::online;
  status.since_ms = 7;
  status.model = "FX3U";
  status.run = true;
  EXPECT_EQ(fxagent::json::device_state(status),
            R"({"state":"online","since":7,"reason":null,"model":"FX3U","run":true})");
  EXPECT_EQ(fxagent::json::device_state(test::offline(0, "timeout")),
            R"({"state":"offline","since":7,"reason":"timeout","model":null,"run":null})");
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
}

TEST(MetaJson, HashChangesWithTheTagsAndOnlyThen) {
  DeviceConfig device = test::press("press1");
  const std::string hash = fxagent::json::device_meta(device).hash;
  EXPECT_EQ(fxagent::json::device_meta(test::press("press2")).hash, hash);
  device.tags[0].point.offset = 1;
  EXPECT_NE(fxagent::json::device_meta(device).hash, hash);
}

TEST(ResultJson, IsTheContractsExample) {
  CommandResult result = test::succeeded("b7e1");
  result.targets[0].verify = Verification{Value(std::int64_t{50}), true};
  result.received_ms = 1790000000000;
  result.queue = 22100us;
  result.wire = 38700us;
  result.bound = 230ms;
  EXPECT_EQ(json::parse(fxagent::json::result(result, 62ms)), json::parse(R"({
    "id": "b7e1", "status": "SUCCEEDED", "reason": null, "detail": null, "plc": "ACK",
    "op": "write", "tag": "setpoint", "address": "D200", "value": 50,
    "verify": {"read": 50, "match": true},
    "t": {"received": 1790000000000, "queue_ms": 22.1, "wire_ms": 38.7, "total_ms": 62.0,
          "bound_ms": 230.0}, "attempts": 1})"));
}

TEST(ResultJson, RefusalOfWhatCouldNotBeReadHasNulls) {
  CommandResult result;
  result.reason = Reason::bad_json;
  result.detail = "not JSON";
  EXPECT_EQ(json::parse(fxagent::json::result(result, 0ms)), json::parse(R"({
    "id": null, "status": "REJECTED", "reason": "bad_json", "detail": "not JSON", "plc": null,
    "op": null, "tag": null, "address": null, "value": null, "verify": null,
    "t": {"received": 0, "queue_ms": 0, "wire_ms": 0, "total_ms": 0, "bound_ms": null},
    "attempts": 0})"));
}

TEST(ResultJson, ListHasAStatusForEachTarget) {
  CommandResult result = test::succeeded("x");
  result.is_list = true;
  result.one_frame = true;
  result.dry_run = true;
  result.targets.push_back(result.targets[0]);
  result.targets[1].status = CommandStatus::failed;
  result.targets[1].reason = Reason::nak;
  result.targets[1].plc = PlcAnswer::nak;
  const json parsed = json::parse(fxagent::json::result(result, 0ms));
  EXPECT_FALSE(parsed.contains("tag"));
  EXPECT_EQ(parsed["one_frame"], true);
  EXPECT_EQ(parsed["dry_run"], true);
  ASSERT_EQ(parsed["targets"].size(), 2U);
  EXPECT_EQ(parsed["targets"][0]["status"], "SUCCEEDED");
  EXPECT_EQ(parsed["targets"][1]["reason"], "nak");
  EXPECT_EQ(parsed["targets"][1]["plc"], "NAK");
}

TEST(ResultJson, DuplicateCarriesTheFirstResult) {
  CommandResult result;
  result.id = "x";
  result.status = CommandStatus::duplicate;
  result.reason = Reason::duplicate_id;
  EXPECT_EQ(json::parse(fxagent::json::result(result, 0ms))["first"], nullptr);
  result.first = std::make_shared<const CommandResult>(test::succeeded("x"));
  const json first = json::parse(fxagent::json::result(result, 0ms))["first"];
  EXPECT_EQ(first["status"], "SUCCEEDED");
  EXPECT_EQ(first["value"], 50);
}

TEST(HealthJson, HasEveryCounterByName) {
  fxagent::json::Health health;
  health.samples.collected = 3;
  health.samples.acknowledged = 3;
  health.field = test::counted(0, 0);
  health.field.links.resize(1);
  health.field.links[0].exchanges = 9;
  health.field.links[0].turnaround_ms.p50 = 1.5;
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

// ---- commands -----------------------------------------------------------------------------------

TEST(CommandJson, ReadsTheContractsExample) {
  const Command command = fxagent::json::command(
      R"({"id": "b7e1", "op": "write", "tag": "setpoint", "value": 50, "expires": 1790000010000,
          "expect": 45, "verify": true, "dry_run": false, "by": "anna"})");
  EXPECT_FALSE(command.refusal) << command.refusal->detail;
  EXPECT_EQ(command.id, "b7e1");
  EXPECT_EQ(command.op, Op::write);
  EXPECT_EQ(command.op_text, "write");
  ASSERT_EQ(command.targets.size(), 1U);
  EXPECT_EQ(command.targets[0].tag, "setpoint");
  EXPECT_EQ(command.targets[0].value, Value(std::int64_t{50}));
  EXPECT_EQ(command.expires_ms, 1790000010000);
  EXPECT_EQ(command.expect, Value(std::int64_t{45}));
  EXPECT_EQ(command.verify, true);
  EXPECT_FALSE(command.dry_run);
  EXPECT_EQ(command.by, "anna");
}

TEST(CommandJson, ReadsAnAddressWithType) {
  const Command command = fxagent::json::command(
      R"({"id":"1","op":"write","address":"D7","type":"float32","value":[1.5,true,"x"]})");
  EXPECT_FALSE(command.refusal);
  EXPECT_EQ(command.targets.at(0).address, "D7");
  EXPECT_EQ(command.targets.at(0).type, DataType::float32);
  EXPECT_EQ(command.targets.at(0).value, Value::array({1.5, true, std::string("x")}));
}

TEST(CommandJson, ReadsTargets) {
  const Command command = fxagent::json::command(
      R"({"id":"1","op":"write","targets":[{"tag":"a","value":1},{"address":"D1","value":[2]}]})");
  EXPECT_FALSE(command.refusal);
  EXPECT_TRUE(command.is_list);
  ASSERT_EQ(command.targets.size(), 2U);
  EXPECT_EQ(command.targets[1].address, "D1");
}

TEST(CommandJson, NullIsAsGoodAsAbsent) {
  const std::vector<std::pair<std::string, std::string>> pairs{
      {R"({"id":"1","op":"write","tag":"a","value":1,"address":null,"type":null,"targets":null,
           "verify":null,"by":null})",
       R"({"id":"1","op":"write","tag":"a","value":1})"},
      {R"({"id":"1","op":"write","tag":null,"value":null,"targets":[
           {"tag":"a","address":null,"value":1},{"tag":null,"address":"D1","type":null,"value":2}]})",
       R"({"id":"1","op":"write","targets":[{"tag":"a","value":1},{"address":"D1","value":2}]})"},
      {R"({"id":"1","op":"run","tag":null,"address":null,"value":null})",
       R"({"id":"1","op":"run"})"}};
  for (const auto& [with_nulls, without] : pairs) {
    const Command filled = fxagent::json::command(with_nulls);
    const Command plain = fxagent::json::command(without);
    ASSERT_FALSE(filled.refusal) << filled.refusal->detail;
    ASSERT_EQ(filled.targets.size(), plain.targets.size()) << without;
    for (std::size_t i = 0; i < plain.targets.size(); ++i) {
      EXPECT_EQ(filled.targets[i].tag, plain.targets[i].tag);
      EXPECT_EQ(filled.targets[i].address, plain.targets[i].address);
      EXPECT_EQ(filled.targets[i].type, plain.targets[i].type);
      EXPECT_EQ(filled.targets[i].value, plain.targets[i].value);
    }
    EXPECT_EQ(filled.is_list, plain.is_list);
    EXPECT_EQ(filled.expires_ms, plain.expires_ms);
    EXPECT_EQ(filled.verify, plain.verify);
    EXPECT_EQ(filled.dry_run, plain.dry_run);
  }
}

TEST(CommandJson, NullIsNoConditionThatGotLost) {
  for (const std::string key : {"expires", "expect", "dry_run"}) {
    const Command command = fxagent::json::command(
        R"({"id":"1","op":"write","tag":"a","value":1,")" + key + R"(":null})");
    ASSERT_TRUE(command.refusal) << key;
    EXPECT_EQ(command.refusal->reason, Reason::bad_value) << key;
  }
}

TEST(ResultJson, PartialListTellsHowFarItCameAndWhatBecameOfEachTarget) {
  CommandResult result;
  result.id = "a";
  result.op = "write";
  result.is_list = true;
  result.status = CommandStatus::partial;
  result.reason = Reason::shutting_down;
  result.progress = Progress{1, 2};
  result.targets.resize(2);
  result.targets[0].status = CommandStatus::succeeded;
  result.targets[1].status = CommandStatus::partial;
  result.targets[1].progress = Progress{32, 100};
  const json told = json::parse(fxagent::json::result(result, std::nullopt));
  EXPECT_EQ(told["status"], "PARTIAL");
  EXPECT_EQ(told["reason"], "shutting_down");
  EXPECT_EQ(told["done"], 1);
  EXPECT_EQ(told["of"], 2);
  EXPECT_FALSE(told["targets"][0].contains("done"));
  EXPECT_EQ(told["targets"][1]["done"], 32);
  EXPECT_EQ(told["targets"][1]["of"], 100);
}

TEST(ResultJson, OneExchangeHasNoProgress) {
  CommandResult result;
  result.status = CommandStatus::unknown_outcome;
  const json told = json::parse(fxagent::json::result(result, std::nullopt));
  EXPECT_FALSE(told.contains("done") || told.contains("of"));
}

TEST(RecordedResult, PartialIsPartialAfterARestart) {
  const CommandResult result =
      fxagent::json::recorded_result(R"({"id":"a","status":"PARTIAL","plc":"NAK"})");
  EXPECT_EQ(result.status, CommandStatus::partial);
  EXPECT_EQ(result.plc, PlcAnswer::nak);
}

TEST(RecordedResult, DamagedRecordIsAnUnknownOutcomeAndNotPublishedAsItIs) {
  using namespace std::string_literals;
  for (const std::string& text : {""s, "{\"status\":\"SUCC"s, "[1]"s, "\xFF"s,
                                  "{\"status\":\"SUCCEEDED\"}\0,"s, "\xEF\xBB\xBF{}"s}) {
    CommandResult result = fxagent::json::recorded_result(text);
    result.id = "a";
    EXPECT_EQ(result.status, CommandStatus::unknown_outcome) << text;
    const json told = json::parse(fxagent::json::result(result, std::nullopt));
    EXPECT_EQ(told["id"], "a");
    EXPECT_EQ(told["status"], "UNKNOWN_OUTCOME");
    EXPECT_EQ(told["detail"], "the record of the result is damaged");
  }
}

TEST(CommandJson, NothingFollowsTheCommand) {
  const std::string order = R"({"id":"1","op":"run"})";
  for (const char* const more : {"", "{\"id\":\"2\",\"op\":\"stop\"}"}) {
    const Command command = fxagent::json::command(order + '\0' + more);
    EXPECT_EQ(command.id, "1");
    ASSERT_TRUE(command.refusal);
    EXPECT_EQ(command.refusal->reason, Reason::bad_json);
    EXPECT_NE(command.refusal->detail.find("NUL"), std::string::npos);
  }
}

TEST(Row, IsIntactWhereItCanStandAmongOthers) {
  using namespace std::string_literals;
  EXPECT_TRUE(fxagent::json::is_intact(R"({"ts":1})"));
  for (const std::string& row : {""s, "{\"ts\":1"s, "{\"ts\":1}\0001}"s, "\xEF\xBB\xBF{}"s})
    EXPECT_FALSE(fxagent::json::is_intact(row)) << row;
}

TEST(CommandJson, RunNeedsNoTarget) {
  const Command command = fxagent::json::command(R"({"id":"1","op":"run"})");
  EXPECT_FALSE(command.refusal);
  EXPECT_TRUE(command.targets.empty());
}

struct Refused {
  const char* name;
  std::string payload;
  Reason reason;
  const char* detail_has;
  const char* id;
};

class CommandRefusal : public testing::TestWithParam<Refused> {};

TEST_P(CommandRefusal, IsTheFirstInTheOrderOfChecks) {
  const Command command = fxagent::json::command(GetParam().payload);
  ASSERT_TRUE(command.refusal);
  EXPECT_EQ(to_string(command.refusal->reason), to_string(GetParam().reason));
  EXPECT_NE(command.refusal->detail.find(GetParam().detail_has), std::string::npos)
      << command.refusal->detail;
  EXPECT_EQ(command.id, GetParam().id);
}

std::string write_with(const std::string& rest) {
  return R"({"id":"a","op":"write","tag":"t","value":1,)" + rest + "}";
}

INSTANTIATE_TEST_SUITE_P(
    Json, CommandRefusal,
    testing::Values(
        Refused{"TooLarge", std::string(65537, ' '), Reason::too_large, "65536", ""},
        Refused{"NoJson", "write 50", Reason::bad_json, "not JSON", ""},
        Refused{"Empty", "", Reason::bad_json, "not JSON", ""},
        Refused{"Truncated", R"({"id":"a")", Reason::bad_json, "not JSON", ""},
        Refused{"Nan", R"({"id":"a","op":"write","tag":"t","value":NaN})", Reason::bad_json, "",
                ""},
        Refused{"TooLargeANumber", R"({"id":"a","value":1e999})", Reason::bad_json, "", ""},
        Refused{"BadUtf8", "{\"id\":\"\xFF\"}", Reason::bad_json, "", ""},
        Refused{"Array", "[1]", Reason::bad_json, "object", ""},
        Refused{"Deep", write_with(R"("expect":[[[[[1]]]]])"), Reason::bad_json, "deep", "a"},
        Refused{"VeryDeep", std::string(60000, '['), Reason::bad_json, "", ""},
        Refused{"UnknownKey", write_with(R"("expirs":1)"), Reason::bad_json, "expires", "a"},
        Refused{"UnknownKeyInTargets",
                R"({"id":"a","op":"write","targets":[{"tag":"t","valeu":1}]})", Reason::bad_json,
                "value", "a"},
        Refused{"KeyTwice", R"({"id":"a","op":"write","tag":"t","value":1,"value":2})",
                Reason::bad_json, "twice", "a"},
        Refused{"Status", write_with(R"("status":"SUCCEEDED")"), Reason::bad_json, "status", "a"},
        Refused{"StatusOfAnyType", R"({"status":null})", Reason::bad_json, "status", ""},
        Refused{"NoId", R"({"op":"run"})", Reason::missing_id, "no id", ""},
        Refused{"NumberAsId", R"({"id":5,"op":"run"})", Reason::missing_id, "string", ""},
        Refused{"EmptyId", R"({"id":"","op":"run"})", Reason::missing_id, "1 to 64", ""},
        Refused{"LongId", R"({"op":"run","id":")" + std::string(65, 'x') + "\"}",
                Reason::missing_id, "1 to 64", ""},
        Refused{"IdWithControl", R"({"id":"a\u0007","op":"run"})", Reason::missing_id, "ASCII", ""},
        Refused{"IdNotAscii", R"({"id":"ä","op":"run"})", Reason::missing_id, "ASCII", ""},
        Refused{"NullAsId", R"({"id":null,"op":"run"})", Reason::missing_id, "no id", ""},
        Refused{"NoOp", R"({"id":"a","tag":"t"})", Reason::bad_op, "no op", "a"},
        Refused{"NullAsOp", R"({"id":"a","op":null,"tag":"t"})", Reason::bad_op, "no op", "a"},
        Refused{"NullAsTarget", R"({"id":"a","op":"read","tag":null})", Reason::unknown_tag,
                "neither", "a"},
        Refused{"NullInAnArray", R"({"id":"a","op":"write","tag":"t","value":[1,null]})",
                Reason::bad_value, "value", "a"},
        Refused{"NullOfAnUnknownKey", write_with(R"("expirs":null)"), Reason::bad_json, "expires",
                "a"},
        Refused{"UnknownOp", R"({"id":"a","op":"Write","tag":"t"})", Reason::bad_op, "'Write'",
                "a"},
        Refused{"NumberAsOp", R"({"id":"a","op":1,"tag":"t"})", Reason::bad_op, "string", "a"},
        Refused{"NoTarget", R"({"id":"a","op":"read"})", Reason::unknown_tag, "neither", "a"},
        Refused{"NumberAsTag", R"({"id":"a","op":"read","tag":1})", Reason::unknown_tag, "tag",
                "a"},
        Refused{"NumberAsAddress", R"({"id":"a","op":"read","address":100})", Reason::bad_address,
                "address", "a"},
        Refused{"TagAndAddress", R"({"id":"a","op":"read","tag":"t","address":"D1"})",
                Reason::bad_address, "exclude", "a"},
        Refused{"UnknownType", R"({"id":"a","op":"read","address":"D1","type":"int17"})",
                Reason::bad_address, "", "a"},
        Refused{"TypeOfATag", R"({"id":"a","op":"read","tag":"t","type":"int16"})",
                Reason::bad_address, "type", "a"},
        Refused{"TargetsAndTag", R"({"id":"a","op":"write","tag":"t","targets":[{"tag":"t"}]})",
                Reason::bad_address, "in place of", "a"},
        Refused{"NoTargets", R"({"id":"a","op":"write","targets":[]})", Reason::bad_address,
                "at least one", "a"},
        Refused{"TargetsOfNumbers", R"({"id":"a","op":"write","targets":[1]})", Reason::bad_address,
                "object", "a"},
        Refused{"ObjectAsValue", R"({"id":"a","op":"write","tag":"t","value":{}})",
                Reason::bad_value, "value", "a"},
        Refused{"TextAsExpires", write_with(R"("expires":"soon")"), Reason::bad_value, "expires",
                "a"},
        Refused{"NegativeExpires", write_with(R"("expires":-1)"), Reason::bad_value, "expires",
                "a"},
        Refused{"HugeExpires", write_with(R"("expires":1e300)"), Reason::bad_value, "expires", "a"},
        Refused{"NullAsExpect", write_with(R"("expect":null)"), Reason::bad_value, "expect", "a"},
        Refused{"ExpectOfAList",
                R"({"id":"a","op":"write","targets":[{"tag":"t","value":1}],"expect":1})",
                Reason::bad_value, "single", "a"},
        Refused{"TextAsVerify", write_with(R"("verify":"no")"), Reason::bad_value, "verify", "a"},
        Refused{"TextAsDryRun", write_with(R"("dry_run":"true")"), Reason::bad_value, "dry_run",
                "a"},
        Refused{"NumberAsBy", write_with(R"("by":7)"), Reason::bad_value, "by", "a"},
        Refused{"JsonBeforeId", R"({"id":5,"colour":1})", Reason::bad_json, "colour", ""},
        Refused{"OpBeforeValue", R"({"id":"a","op":"x","tag":"t","verify":1})", Reason::bad_op, "",
                "a"},
        Refused{"TargetBeforeValue", R"({"id":"a","op":"write","verify":1,"value":1})",
                Reason::unknown_tag, "", "a"}),
    [](const auto& refused) { return refused.param.name; });

// ---- what is too large

std::string text_of(const CommandResult& result) {
  return fxagent::json::result(result, std::nullopt);
}

TEST(JsonCommand, MoreThanSixtyFourTargetsAreTooLargeAndNoneOfThemIsKept) {
  const auto with = [](int count) {
    std::string targets;
    for (int i = 0; i < count; ++i) targets += (i == 0 ? "" : ",") + std::string(R"({"tag":"a"})");
    return fxagent::json::command(R"({"id":"b7e1","op":"write","targets":[)" + targets + "]}");
  };
  EXPECT_FALSE(with(64).refusal && with(64).refusal->reason == Reason::too_large);
  const Command many = with(65);
  ASSERT_TRUE(many.refusal);
  EXPECT_EQ(many.refusal->reason, Reason::too_large);
  EXPECT_EQ(many.id, "b7e1");
  EXPECT_TRUE(many.targets.empty());
  std::string empty = "{}";
  while (empty.size() < 63000) empty += ",{}";
  const Command hostile =
      fxagent::json::command(R"({"id":"x","op":"write","targets":[)" + empty + "]}");
  EXPECT_TRUE(hostile.targets.empty());
}

TEST(JsonCommand, PlaceThatNobodyCanMeanIsCutOff) {
  const Command parsed = fxagent::json::command(R"({"id":"b7e1","op":"read","tag":")" +
                                                std::string(60000, 'a') + R"("})");
  EXPECT_LE(parsed.targets.at(0).tag.size(), 128U);
}

TEST(JsonResult, NoneIsLargerThanSixtyFourKibibytes) {
  CommandResult list;
  list.id = "b7e1";
  list.is_list = true;
  for (int i = 0; i < 64; ++i) {
    TargetResult target;
    target.tag = "t" + std::to_string(i);
    target.detail = std::string(1000, 'd');
    target.value = Value(std::string(100, 'v'));
    list.targets.push_back(target);
  }
  const auto without_details = json::parse(text_of(list));
  EXPECT_TRUE(without_details["targets"][0]["detail"].is_null());
  EXPECT_EQ(without_details["targets"][63]["value"], std::string(100, 'v'));
  for (TargetResult& target : list.targets) target.value = Value(std::string(2000, 'v'));
  const std::string text = text_of(list);
  EXPECT_LE(text.size(), 65536U);
  const auto without_values = json::parse(text);
  EXPECT_TRUE(without_values["targets"][0]["value"].is_null());
  EXPECT_EQ(without_values["targets"][0]["tag"], "t0");
  EXPECT_NE(without_values["detail"].get<std::string>().find("64 KiB"), std::string::npos);

  CommandResult again;
  again.id = "b7e1";
  again.status = CommandStatus::duplicate;
  again.detail = std::string(300, 'd');
  for (TargetResult& target : list.targets) target.value = Value(std::string(700, 'v'));
  again.first =
      std::make_shared<const CommandResult>(fxagent::json::recorded_result(text_of(list)));
  EXPECT_LE(text_of(again).size(), 65536U);
}

}  // namespace
}  // namespace fxagent
