// modbus.json of the ThingsBoard gateway.
#include <gtest/gtest.h>

#include "tests/agent/import/outcome.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;

Made thingsboard(std::string_view text) { return made_of(text, import_thingsboard); }

TEST(Thingsboard, ASlaveOverTcp) {
  const Made made = thingsboard(R"({"master": {"slaves": [{
    "host": "127.0.0.1", "port": 5021, "type": "tcp", "method": "socket", "unitId": 3,
    "deviceName": "Demo Device", "byteOrder": "BIG", "wordOrder": "LITTLE", "pollPeriod": 1000,
    "attributes": [{"tag": "power", "type": "16int", "functionCode": 3, "objectsCount": 1, "address": 2, "divider": 10}],
    "timeseries": [
      {"tag": "energy", "type": "32uint", "functionCode": 4, "objectsCount": 2, "address": 10, "multiplier": 0.001},
      {"tag": "relay", "type": "bits", "address": 1, "objectsCount": 1, "functionCode": 1},
      {"tag": "guard", "type": "bits", "address": 1, "objectsCount": 3, "functionCode": 2},
      {"tag": "name", "type": "string", "address": 30, "objectsCount": 4, "functionCode": 3},
      {"tag": "words", "type": "16uint", "address": 40, "objectsCount": 3, "functionCode": 3},
      {"tag": "byte", "type": "8int", "address": 50, "objectsCount": 1, "functionCode": 3}],
    "attributeUpdates": [{"tag": "relay", "type": "bits", "address": 1, "objectsCount": 1, "functionCode": 5}],
    "rpc": [{"tag": "reset", "type": "bits", "address": 9, "objectsCount": 1, "functionCode": 5}]}]},
    "slave": {"type": "tcp"}})");
  const json& device = made.config["devices"][0];
  EXPECT_EQ(device["name"], "demo_device");
  EXPECT_EQ(device["protocol"], "modbus-tcp");
  EXPECT_EQ(device["unit"], 3);
  EXPECT_EQ(device["byte_order"], "CDAB");
  EXPECT_EQ(device["tags"], json::parse(R"([
    {"name":"power","address":"hr:2","type":"int16","scale":0.1,"group":"every_1000_ms"},
    {"name":"energy","address":"ir:10","type":"uint32","scale":0.001,"group":"every_1000_ms"},
    {"name":"relay","address":"co:1","group":"every_1000_ms","access":"read_write"},
    {"name":"guard","address":"di:1","count":3,"group":"every_1000_ms"},
    {"name":"name","address":"hr:30","type":"string","length":8,"word_order":"high_first","group":"every_1000_ms"},
    {"name":"words","address":"hr:40","type":"uint16","group":"every_1000_ms"}
  ])"));
  expect_note(made, {"left out: byte", "8int"});
  expect_note(made, {"left out: reset of rpc belongs to no value that is read"});
  expect_note(made, {"left out: \"slave\""});
}

TEST(Thingsboard, ValuesOfFourRegistersHaveTheirTypeAndOrder) {
  const Made made = thingsboard(R"({"master": {"slaves": [{
    "host": "127.0.0.1", "port": 502, "type": "tcp", "unitId": 3, "deviceName": "d",
    "byteOrder": "BIG", "wordOrder": "BIG", "pollPeriod": 1000,
    "timeseries": [
      {"tag": "a", "type": "64int", "address": 0, "objectsCount": 4, "functionCode": 3},
      {"tag": "b", "type": "64uint", "address": 4, "objectsCount": 4, "functionCode": 3, "divider": 1000},
      {"tag": "c", "type": "64float", "address": 8, "objectsCount": 4, "functionCode": 4, "wordOrder": "LITTLE"},
      {"tag": "d", "type": "double", "address": 12, "objectsCount": 4, "functionCode": 4},
      {"tag": "e", "type": "long", "address": 16, "objectsCount": 4, "functionCode": 4}]}]}})");
  EXPECT_FALSE(made.config["devices"][0].contains("byte_order")) << "ABCD is the default";
  EXPECT_EQ(made.config["devices"][0]["tags"], json::parse(R"([
    {"name":"a","address":"hr:0","type":"int64","group":"every_1000_ms"},
    {"name":"b","address":"hr:4","type":"uint64","scale":0.001,"group":"every_1000_ms"},
    {"name":"c","address":"ir:8","type":"float64","word_order":"CDAB","group":"every_1000_ms"},
    {"name":"d","address":"ir:12","type":"float64","group":"every_1000_ms"},
    {"name":"e","address":"ir:16","type":"int64","group":"every_1000_ms"}])"));
  EXPECT_EQ(made.notes.size(), 0U) << all_of(made.notes);
}

TEST(Thingsboard, NoSettingIsDroppedInSilence) {
  const Made made = thingsboard(R"({"name": "gw", "master": {"slaves": [{
    "host": "127.0.0.1", "port": 502, "type": "tcp", "method": "socket", "unitId": 3, "deviceName": "d",
    "timeout": 3.5, "delayBetweenRequestsMs": 20, "retries": true, "connectAttemptTimeMs": 5000,
    "security": {"certfile": "x"}, "strict": null,
    "timeseries": [{"tag": "a", "type": "16int", "functionCode": 3, "objectsCount": 1, "address": 2,
                    "min": 0, "reportStrategy": {"type": "ON_CHANGE"}},
                   {"tag": "b", "type": "16int", "functionCode": 3, "objectsCount": 1, "address": 3}]}]}})");
  EXPECT_EQ(made.config["devices"][0]["timeout_ms"], 3500);
  EXPECT_EQ(made.config["devices"][0]["gap_ms"], 20);
  expect_note(made, {"not imported: retries, connectAttemptTimeMs, security of the slave d"});
  expect_note(made, {"not imported: min, reportStrategy of a"});
  expect_note(made, {"not imported: name of the file"});
  expect_notes(3, made, {"not imported"});
}

TEST(Thingsboard, SlavesOnOneSerialLine) {
  const Made made = thingsboard(R"({"master": {"slaves": [
    {"type": "serial", "method": "rtu", "port": "/dev/ttyUSB0", "baudrate": 19200, "stopbits": 1, "bytesize": 8,
     "parity": "N", "unitId": 1, "deviceName": "a",
     "timeseries": [{"tag": "t", "type": "16int", "functionCode": 3, "objectsCount": 1, "address": 0}]},
    {"type": "serial", "method": "rtu", "port": "/dev/ttyUSB0", "unitId": 2, "deviceName": "b",
     "timeseries": [{"tag": "t", "type": "16int", "functionCode": 3, "objectsCount": 1, "address": 0}]}]}})");
  ASSERT_EQ(made.config["devices"].size(), 2U) << all_of(made.notes);
  EXPECT_EQ(made.config["links"], json::parse(R"([{"name":"line1","serial":{"baud":19200,
      "data_bits":8,"parity":"none","stop_bits":1,"path":"/dev/ttyUSB0"}}])"));
  EXPECT_EQ(made.config["devices"][0]["byte_order"], "DCBA");
}

TEST(Thingsboard, ASerialLineIsWhatTheGatewayTakesItFor) {
  const Made made = thingsboard(R"({"master": {"slaves": [
    {"type": "serial", "method": "rtu", "port": "/dev/ttyUSB0", "unitId": 1, "deviceName": "a",
     "timeseries": [{"tag": "t", "type": "16int", "functionCode": 3, "address": 0}]}]}})");
  EXPECT_EQ(made.config["links"], json::parse(R"([{"name":"line1","serial":{"baud":19200,
      "data_bits":8,"parity":"none","stop_bits":1,"path":"/dev/ttyUSB0"}}])"));
}

/// Imports a slave with these timeseries.
Made series(const std::string& list) {
  return thingsboard(R"({"master": {"slaves": [{"host": "192.0.2.7", "port": 502, "type": "TCP",
    "method": "Socket", "deviceName": "a", "byteOrder": "big", "wordOrder": "Big",
    "timeseries": [)" +
                     list + "]}]}}");
}

TEST(Thingsboard, ASlaveWithoutAUnitIsUnitOne) {
  const Made made = series(R"({"tag": "t", "type": "16int", "functionCode": 3, "address": 0})");
  EXPECT_EQ(made.config["devices"][0]["unit"], 1);
}

TEST(Thingsboard, TheOrderOfATagWins) {
  const Made made = series(R"(
    {"tag": "a", "type": "32INT", "functionCode": 3, "objectsCount": 2, "address": 0},
    {"tag": "b", "type": "32int", "functionCode": 3, "objectsCount": 2, "address": 2, "wordOrder": "little"},
    {"tag": "c", "type": "32int", "functionCode": 3, "objectsCount": 2, "address": 4,
     "byteOrder": "LITTLE", "wordOrder": "LITTLE"},
    {"tag": "d", "type": "16int", "functionCode": 3, "address": 6, "byteOrder": "LITTLE"})");
  EXPECT_FALSE(made.config["devices"][0].contains("byte_order"));
  const json& tags = made.config["devices"][0]["tags"];
  ASSERT_EQ(tags.size(), 4U) << all_of(made.notes);
  EXPECT_FALSE(tags[0].contains("word_order"));
  EXPECT_EQ(tags[1]["word_order"], "CDAB");
  EXPECT_EQ(tags[2]["word_order"], "DCBA");
  EXPECT_EQ(tags[3]["word_order"], "BADC");
}

TEST(Thingsboard, AWidthOfItsOwnIsOneValue) {
  const Made made = series(R"(
    {"tag": "a", "type": "16int", "functionCode": 3, "objectsCount": 2, "address": 0},
    {"tag": "b", "type": "32int", "functionCode": 3, "objectsCount": 4, "address": 2},
    {"tag": "c", "type": "float", "functionCode": 3, "objectsCount": 3, "address": 6},
    {"tag": "d", "type": "float", "functionCode": 3, "objectsCount": 2, "address": 10},
    {"tag": "e", "type": "16int", "functionCode": 3, "address": 12})");
  ASSERT_EQ(made.config["devices"][0]["tags"].size(), 4U) << all_of(made.notes);
  for (const json& tag : made.config["devices"][0]["tags"]) EXPECT_FALSE(tag.contains("count"));
  expect_note(made, {"a: ", "one value"});
  expect_note(made, {"b: ", "one value"});
  expect_note(made, {"left out: c", "float", "3 registers"});
  EXPECT_EQ(made.notes.size(), 3U) << all_of(made.notes);
}

TEST(Thingsboard, DividerAndMultiplierBothApply) {
  const Made made = series(R"({"tag": "a", "type": "16int", "functionCode": 3, "address": 0,
    "divider": 10, "multiplier": 5})");
  EXPECT_EQ(made.config["devices"][0]["tags"][0]["scale"], 0.5);
}

TEST(Thingsboard, IsToldFromOtherJson) {
  EXPECT_TRUE(is_thingsboard(R"({"master": {"slaves": []}})"));
  EXPECT_FALSE(is_thingsboard(R"({"nodes": []})"));
  EXPECT_FALSE(import_thingsboard("{}", {}));
}

constexpr const char* kSlaves = R"({"master": {"slaves": [{"host": "192.0.2.7", "port": 502,
    "type": "tcp", "method": "socket", "deviceName": "a", "byteOrder": "BIG", "wordOrder": "BIG"%s,
    "timeseries": [{"tag": "t", "type": "16int", "functionCode": 3, "address": 0}]}]}})";

std::string slaves_with(const std::string& keys) {
  std::string text = kSlaves;
  return text.replace(text.find("%s"), 2, keys);
}

TEST(Thingsboard, WhatAGatewaysPageExportsHasTheFileWithin) {
  const std::string inner = R"({"name": "m", "type": "modbus", "sendDataOnlyOnChange": true,
      "configurationJson": )" +
                            slaves_with("") + "}";
  for (const std::string& text : {inner, "{\"Modbus 1\": " + inner + "}"}) {
    EXPECT_TRUE(is_thingsboard(text)) << text;
    const Made made = thingsboard(text);
    EXPECT_EQ(made.config["devices"][0]["tags"][0]["address"], "hr:0");
    EXPECT_EQ(made.config["devices"][0]["groups"][0].value("publish", ""), "on_change");
    EXPECT_TRUE(made.notes.empty()) << all_of(made.notes);
  }
}

TEST(Thingsboard, TheFirstGenerationIsNamedWithItsCure) {
  const std::string text = "{\n\"server\": {\"host\": \"h\", \"devices\": []}}";
  EXPECT_TRUE(is_thingsboard(text));
  const auto old = import_thingsboard(text, {});
  ASSERT_FALSE(old);
  EXPECT_EQ(old.error().line, 2);
  EXPECT_NE(old.error().text.find("before version 3"), std::string::npos) << old.error().text;
  EXPECT_NE(old.error().text.find("modbus_new.json"), std::string::npos) << old.error().text;
}

TEST(Thingsboard, WhatIsSentOnChangeIsPublishedSo) {
  const auto group_of = [](const std::string& keys) {
    const Made made = thingsboard(slaves_with(keys));
    EXPECT_TRUE(made.notes.empty()) << all_of(made.notes);
    return made.config["devices"][0]["groups"][0];
  };
  const json always = json::parse(R"({"name":"every_5000_ms","interval_ms":5000})");
  json on_change = always;
  on_change["publish"] = "on_change";
  EXPECT_EQ(group_of(""), always);
  EXPECT_EQ(group_of(R"(, "sendDataOnlyOnChange": false)"), always);
  EXPECT_EQ(group_of(R"(, "sendDataOnlyOnChange": true)"), on_change);
  EXPECT_EQ(group_of(R"(, "reportStrategy": {"type": "ON_CHANGE"})"), on_change);
  on_change["max_silent_s"] = 90;
  EXPECT_EQ(group_of(R"(, "reportStrategy": {"type": "ON_CHANGE_OR_REPORT_PERIOD",
                       "reportPeriod": 89001})"),
            on_change);
  const Made other =
      thingsboard(slaves_with(R"(, "reportStrategy": {"type": "ON_REPORT_PERIOD"})"));
  expect_note(other, {"not imported: the reportStrategy \"ON_REPORT_PERIOD\""});
}

TEST(Thingsboard, EachFunctionThatWritesMakesItsTagWritable) {
  for (const int function : {5, 15, 6, 16}) {
    const bool is_coil = function == 5 || function == 15;
    const std::string read = is_coil ? "1" : "3";
    const Made made = series(R"({"tag": "a", "type": ")" + std::string(is_coil ? "bits" : "16int") +
                             R"(", "functionCode": )" + read +
                             R"(, "address": 4}], "rpc": [{"tag": "a", "functionCode": )" +
                             std::to_string(function) + R"(, "address": 4})");
    EXPECT_EQ(made.config["devices"][0]["tags"][0].value("access", ""), "read_write") << function;
  }
}

TEST(Thingsboard, TagsOfASlaveThatIsLeftOutAreCounted) {
  EXPECT_EQ(outcome_of(slaves_with(", \"unitId\": 300"), import_thingsboard).left_out, 1U);
  const Made made = outcome_of(R"({"master": {"slaves": [{"type": "udp", "deviceName": "a",
    "attributes": [{"tag": "x"}], "timeseries": [{"tag": "y"}, {"tag": "z"}]}]}})",
                               import_thingsboard);
  EXPECT_TRUE(made.config.is_null());
  EXPECT_EQ(made.left_out, 3U);
}

}  // namespace
}  // namespace fxagent
