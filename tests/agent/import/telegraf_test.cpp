// Telegraf's inputs.modbus.
#include <gtest/gtest.h>

#include "tests/agent/import/outcome.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;

Made telegraf(std::string_view text) { return made_of(text, import_telegraf); }

/// Imports a plugin with these lines.
Made plugin_of(const std::string& lines) {
  return telegraf("[[inputs.modbus]]\nname = \"m\"\ncontroller = \"tcp://192.0.2.1:502\"\n" +
                  lines);
}

TEST(Telegraf, PortOfTheControllerIs502UnlessItHasOne) {
  const auto made = [](const std::string& controller) {
    return telegraf("[[inputs.modbus]]\nname = \"m\"\ncontroller = \"tcp://" + controller +
                    "\"\ncoils = [ { name = \"run\", address = [3]} ]\n");
  };
  for (const char* host : {"a", "[::1]"}) {
    const json tcp = made(host).config["links"][0]["tcp"];
    EXPECT_EQ(tcp["host"], host[0] == '[' ? "::1" : host);
    EXPECT_EQ(tcp["port"], 502);
  }
  const Made wrong = made("a:70000");
  EXPECT_EQ(wrong.config["links"][0]["tcp"]["host"], "192.0.2.1");
  expect_note(wrong, {"1: not imported", "\"a:70000\""});
  expect_note(wrong, {"placeholder"});
}

TEST(Telegraf, TwoProtocolsAtOneHostAndPortAreTwoLinks) {
  const std::string tcp = R"(
[[inputs.modbus]]
  name = "a"
  controller = "tcp://192.0.2.1:502"
  coils = [ { name = "run", address = [3]} ]
)";
  std::string rtu = tcp + "  transmission_mode = \"RTUoverTCP\"\n";
  rtu.replace(rtu.find("\"a\""), 3, "\"b\"");
  const Made made = telegraf(tcp + rtu);
  EXPECT_EQ(made.notes, std::vector<std::string>{});
  ASSERT_EQ(made.config["devices"].size(), 2U);
  EXPECT_EQ(made.config["devices"][1]["protocol"], "modbus-rtu");
  EXPECT_EQ(made.config["devices"][1]["link"], "line2");
  EXPECT_EQ(made.config["links"][1]["tcp"], made.config["links"][0]["tcp"]);
}

TEST(Telegraf, StyleOfRegisters) {
  const Made made = telegraf(R"(
[agent]
  interval = "5s"
[[inputs.modbus]]
  name = "Device"
  slave_id = 4
  timeout = "1s"
  controller = "tcp://localhost:502"
  discrete_inputs = [ { name = "start", address = [0]} ]
  coils = [ { name = "motor1_run", address = [3]} ]
  holding_registers = [
    { name = "power_factor", byte_order = "AB", data_type = "FIXED", scale=0.01, address = [8]},
    { name = "energy", byte_order = "CDAB", data_type = "UFIXED", scale=0.001, address = [5,6]},
    { name = "torn", byte_order = "ABCD", data_type = "INT32", scale=1.0, address = [5,7]},
    { name = "half", byte_order = "AB", data_type = "FLOAT16-IEEE", scale=1.0, address = [5]},
  ]
  input_registers = [
    { name = "ph", byte_order = "ABCD", data_type = "FLOAT32-IEEE", scale=1.0, address = [1,2]},
  ]
[[inputs.cpu]]
)");
  const json& device = made.config["devices"][0];
  EXPECT_EQ(device["name"], "device");
  EXPECT_EQ(device["unit"], 4);
  EXPECT_EQ(device["timeout_ms"], 1000);
  EXPECT_EQ(device["groups"][0]["interval_ms"], 5000);
  EXPECT_EQ(device["tags"], json::parse(R"([
    {"name":"start","address":"di:0","group":"every_5000_ms"},
    {"name":"motor1_run","address":"co:3","group":"every_5000_ms"},
    {"name":"power_factor","address":"hr:8","type":"int16","scale":0.01,"group":"every_5000_ms"},
    {"name":"energy","address":"hr:5","type":"uint32","word_order":"CDAB","scale":0.001,"group":"every_5000_ms"},
    {"name":"ph","address":"ir:1","type":"float32","word_order":"ABCD","group":"every_5000_ms"}
  ])"));
  expect_note(made, {"14: left out: torn: its addresses are not consecutive"});
  expect_note(made, {"15: left out: half", "FLOAT16-IEEE"});
  expect_note(made, {"left out: inputs.cpu"});
}

TEST(Telegraf, ValuesOfFourRegistersHaveTheirTypeAndOrder) {
  const Made made = telegraf(R"(
[[inputs.modbus]]
  name = "m"
  controller = "tcp://localhost:502"
  holding_registers = [
    { name = "a", byte_order = "ABCDEFGH", data_type = "INT64", scale=0.1, address = [0,1,2,3]},
    { name = "b", byte_order = "HGFEDCBA", data_type = "UINT64", scale=1.0, address = [4,5,6,7]},
    { name = "c", byte_order = "BADCFEHG", data_type = "FLOAT64-IEEE", scale=1.0, address = [8,9,10,11]},
    { name = "d", byte_order = "GHEFCDAB", data_type = "FIXED", scale=0.01, address = [12,13,14,15]},
    { name = "e", byte_order = "ABCDEFGH", data_type = "UFIXED", scale=1.0, address = [16,17,18,19]},
    { name = "f", byte_order = "ABCD", data_type = "FIXED", scale=1.0, address = [20,21,22]},
  ]
[[inputs.modbus]]
  name = "n"
  controller = "tcp://localhost:503"
  configuration_type = "request"
  [[inputs.modbus.request]]
    byte_order = "CDAB"
    fields = [ { address=0, name="g", type="FLOAT64" }, { address=4, name="h", type="UINT64" } ]
)");
  EXPECT_EQ(made.config["devices"][0]["tags"], json::parse(R"([
    {"name":"a","address":"hr:0","type":"int64","word_order":"ABCD","scale":0.1,"group":"every_10000_ms"},
    {"name":"b","address":"hr:4","type":"uint64","word_order":"DCBA","group":"every_10000_ms"},
    {"name":"c","address":"hr:8","type":"float64","word_order":"BADC","group":"every_10000_ms"},
    {"name":"d","address":"hr:12","type":"int64","word_order":"CDAB","scale":0.01,"group":"every_10000_ms"},
    {"name":"e","address":"hr:16","type":"uint64","word_order":"ABCD","group":"every_10000_ms"}])"));
  EXPECT_EQ(made.config["devices"][1]["tags"], json::parse(R"([
    {"name":"g","address":"hr:0","type":"float64","word_order":"CDAB","group":"every_10000_ms"},
    {"name":"h","address":"hr:4","type":"uint64","word_order":"CDAB","group":"every_10000_ms"}])"));
  expect_note(made, {"left out: f: a config has no type \"FIXED\""});
}

TEST(Telegraf, StyleOfRequests) {
  const Made made = telegraf(R"(
[[inputs.modbus]]
  name = "gw"
  controller = "file:///dev/ttyUSB0"
  baud_rate = 19200
  parity = "E"
  transmission_mode = "RTU"
  configuration_type = "request"
  interval = "500ms"
  [[inputs.modbus.request]]
    slave_id = 1
    byte_order = "DCBA"
    register = "holding"
    fields = [
      { address=0, name="voltage", type="INT16", scale=0.1 },
      { address=1, name="current", type="INT32", omit=true },
      { address=5, name="energy", type="FLOAT32", measurement="W" },
    ]
    [inputs.modbus.request.tags]
      machine = "impresser"
  [[inputs.modbus.request]]
    slave_id = 2
    register = "coil"
    fields = [ { address=0, name="run"} ]
)");
  ASSERT_EQ(made.config["devices"].size(), 2U) << all_of(made.notes);
  EXPECT_EQ(made.config["devices"][0]["protocol"], "modbus-rtu");
  EXPECT_EQ(made.config["devices"][1]["name"], "gw_2");
  EXPECT_EQ(made.config["links"][0]["serial"]["parity"], "even");
  EXPECT_EQ(made.config["devices"][0]["tags"], json::parse(R"([
    {"name":"voltage","address":"hr:0","type":"int16","word_order":"DCBA","scale":0.1,"group":"every_500_ms"},
    {"name":"energy","address":"hr:5","type":"float32","word_order":"DCBA","group":"every_500_ms"}])"));
  expect_note(made, {"17: not imported: the measurement \"W\" of 1 field"});
  expect_note(made, {"not imported: the tags of the request"});
}

TEST(Telegraf, StyleOfMetrics) {
  const Made made = plugin_of(R"(  configuration_type = "metric"
  [[inputs.modbus.metric]]
    slave_id = 1
    byte_order = "ABCD"
    fields = [
      { register="coil", address=0, name="door" },
      { register="input", address=3, name="rpm", type="UINT16" },
    ]
)");
  EXPECT_EQ(made.config["devices"][0]["tags"][0]["address"], "co:0");
  EXPECT_EQ(made.config["devices"][0]["tags"][1]["address"], "ir:3");
}

TEST(Telegraf, ModeAutoIsWhatTheControllerTakes) {
  const auto protocol_of = [](const std::string& controller) {
    const Made made = telegraf(
        "[[inputs.modbus]]\n  name = \"m\"\n  transmission_mode = \"auto\"\n"
        "  controller = \"" +
        controller +
        "\"\n"
        "  holding_registers = [{name=\"a\", data_type=\"INT16\", address=[0]}]\n");
    return made.config["devices"][0]["protocol"];
  };
  EXPECT_EQ(protocol_of("file:///dev/ttyUSB0"), "modbus-rtu");
  EXPECT_EQ(protocol_of("tcp://192.0.2.1:502"), "modbus-tcp");
}

TEST(Telegraf, NoSettingIsDroppedInSilence) {
  const Made made = plugin_of(R"(  timeout = "2s"
  pause_between_requests = "30ms"
  busy_retries = 3
  holding_registers = [
    {name="a", data_type="INT16", address=[0], output="FLOAT64"}, {name="b", data_type="INT16", address=[1]}]
  [inputs.modbus.tags]
    plant = "north"
  [inputs.modbus.workarounds]
    one_request_per_field = true
)");
  EXPECT_EQ(made.config["devices"][0]["timeout_ms"], 2000);
  EXPECT_EQ(made.config["devices"][0]["gap_ms"], 30);
  expect_note(made, {"not imported: busy_retries, tags, workarounds of inputs.modbus \"m\""});
  expect_note(made, {"not imported: output of a"});
  expect_notes(2, made, {"not imported"});
}

TEST(Telegraf, NumbersBeyondAllMeasureCostOneTagAtMost) {
  const Made made = telegraf(R"(
[[inputs.modbus]]
  name = "m"
  interval = "1e300h"
  timeout = "nanh"
  controller = "tcp://192.0.2.1:0502"
  holding_registers = [
    {name="a", data_type="INT16", address=[0]},
    {name="b", data_type="INT16", address=[1], scale=inf},
    {name="c", data_type="INT16", address=[2], scale=nan}]
)");
  EXPECT_EQ(made.config["links"][0]["tcp"]["port"], 502);
  EXPECT_EQ(made.config["devices"][0]["tags"].size(), 1U);
  EXPECT_EQ(made.config["devices"][0]["groups"][0]["interval_ms"], 86'400'000);
  expect_note(made, {"left out: \"b\""});
  expect_note(made, {"left out: \"c\""});
}

TEST(Telegraf, NameBeyondAsciiIsSaidToLoseLetters) {
  const Made made = telegraf(
      "[[inputs.modbus]]\nname = \"K\u00FChler\"\ncontroller = \"tcp://192.0.2.1:502\"\n"
      "holding_registers = [{name=\"\u6E29\u5EA6 a\", data_type=\"INT16\", address=[0]}]\n");
  EXPECT_EQ(made.config["devices"][0]["name"], "k_hler");
  EXPECT_EQ(made.config["devices"][0]["tags"][0]["name"], "a");
  expect_note(made, {"is named k_hler"});
  expect_note(made, {"is named a:"});
}

TEST(Telegraf, TableWithoutANameIsAnErrorWithItsLine) {
  EXPECT_EQ(error_of(import_telegraf("[agent]\n[[;inputs.modbus]]\nname = \"a\"\n", {})).line, 2);
}

TEST(Telegraf, BrokenTextHasItsLine) {
  EXPECT_EQ(error_of(import_telegraf("[[inputs.modbus]]\nname = \n", {})).line, 2);
  EXPECT_FALSE(is_telegraf("inputs.modbus ="));
  EXPECT_FALSE(import_telegraf("[agent]\n", {}));
}

TEST(Telegraf, StringsInBothStyles) {
  const Made lists = plugin_of(R"(holding_registers = [
    {name="a", data_type="STRING", byte_order="AB", address=[0,1,2,3]},
    {name="b", data_type="STRING", byte_order="BA", address=[4,5]},
    {name="c", data_type="STRING", byte_order="CDAB", address=[6]}]
)");
  EXPECT_EQ(lists.config["devices"][0]["tags"], json::parse(R"([
    {"name":"a","address":"hr:0","type":"string","length":8,"word_order":"high_first","group":"every_10000_ms"},
    {"name":"b","address":"hr:4","type":"string","length":4,"word_order":"low_first","group":"every_10000_ms"},
    {"name":"c","address":"hr:6","type":"string","length":2,"word_order":"high_first","group":"every_10000_ms"}
  ])"));
  EXPECT_TRUE(lists.notes.empty()) << all_of(lists.notes);
  const Made counts = plugin_of(R"([[inputs.modbus.request]]
  slave_id = 1
  byte_order = "DCBA"
  fields = [{name="a", type="STRING", length=10, address=7}]
)");
  EXPECT_EQ(counts.config["devices"][0]["tags"][0]["length"], 20);
  EXPECT_EQ(counts.config["devices"][0]["tags"][0]["word_order"], "low_first");
}

TEST(Telegraf, OneLineAMeasurementAndACountAtTheEnd) {
  const Made made = plugin_of(R"(holding_registers = [
    {name="a", data_type="INT16", address=[0], measurement="power"},
    {name="b", data_type="INT16", address=[1], measurement="power"},
    {name="c", data_type="INT16", address=[2], measurement="heat"},
    {name="d", data_type="INT16", address=[3], output="FLOAT64"},
    {name="e", data_type="INT16", address=[4]},
    {name="f", data_type="INT8L", address=[5]},
    {name="g", data_type="INT16", address=[70000]}]
)");
  EXPECT_EQ(made.config["devices"][0]["tags"].size(), 5U) << all_of(made.notes);
  expect_note(made, {"5: not imported: the measurement \"power\" of 2 fields"});
  expect_note(made, {"7: not imported: the measurement \"heat\" of 1 field"});
  expect_notes(2, made, {"measurement"});
  EXPECT_EQ(made.changed, 4U);
  EXPECT_EQ(made.left_out, 2U);
}

TEST(Telegraf, TwoLettersAreTheOrderOfOneRegister) {
  const Made made = plugin_of(R"(holding_registers = [
    {name="a", data_type="INT16", byte_order="AB", address=[0]},
    {name="b", data_type="INT16", byte_order="BA", address=[1]}]
)");
  EXPECT_FALSE(made.config["devices"][0]["tags"][0].contains("word_order"));
  EXPECT_EQ(made.config["devices"][0]["tags"][1].value("word_order", ""), "BADC");
}

TEST(Telegraf, TheUnitWhereTheFileNamesNone) {
  const auto unit_of = [](const std::string& lines) {
    const Made made = plugin_of(lines);
    return made.config["devices"][0]["unit"];
  };
  EXPECT_EQ(unit_of("coils = [{name=\"a\", address=[0]}]\n"), 1);
  EXPECT_EQ(unit_of("slave_id = 9\ncoils = [{name=\"a\", address=[0]}]\n"), 9);
}

TEST(Telegraf, RequestThatNamesNoUnitIsOfUnitZero) {
  const Made made = plugin_of(R"(configuration_type = "request"
  [[inputs.modbus.request]]
    register = "holding"
    fields = [ { address=0, name="a", type="INT16" } ]
)");
  EXPECT_EQ(made.config["devices"][0]["unit"], 0);
}

TEST(Telegraf, IntervalsInAllUnits) {
  const auto interval_of = [](const std::string& text) {
    const Made made =
        plugin_of("interval = \"" + text + "\"\ncoils = [{name=\"a\", address=[0]}]\n");
    return made.config["devices"][0]["groups"][0]["interval_ms"];
  };
  EXPECT_EQ(interval_of("2h"), 7'200'000);
  EXPECT_EQ(interval_of("1h30m"), 5'400'000);
  EXPECT_EQ(interval_of("1m30s"), 90'000);
  EXPECT_EQ(interval_of("250ms"), 250);
  EXPECT_EQ(interval_of("5000us"), 5);
}

/// Returns the line reported for text that is nested too deeply; 0 if none.
int deep_line(const std::string& text) {
  const auto read = import_telegraf(text, {});
  if (read || read.error().text.find("more than 32 levels") == std::string::npos) return 0;
  return read.error().line;
}

std::string repeated(std::string_view part, int times) {
  std::string text;
  for (int i = 0; i < times; ++i) text += part;
  return text;
}

TEST(Telegraf, NamesAndBracketsWithoutEndAreAnErrorWithTheirLine) {
  constexpr int kMany = 20'000;
  const std::string dots = "a" + repeated(".a", kMany);
  EXPECT_EQ(deep_line("[agent]\n" + dots + " = 1\n"), 2);
  EXPECT_EQ(deep_line("\n\n[" + dots + "]\n"), 3);
  EXPECT_EQ(deep_line("[[" + dots + "]]\n"), 1);
  EXPECT_EQ(deep_line("a = {" + dots + " = 1}\n"), 1);
  EXPECT_EQ(deep_line("a = " + repeated("[", kMany)), 1);
  EXPECT_EQ(deep_line(repeated("\"=\".", kMany) + "a = 1\n"), 1);
  EXPECT_EQ(deep_line(repeated("'#'.", kMany) + "a = 1\n"), 1);
  // After a """ string that ends with a quote of its own.
  EXPECT_EQ(deep_line("t = {x = \"\"\"a\nb\\\"\"\"\"\", " + dots + " = \"1\"}\n"), 2);
  EXPECT_EQ(deep_line("t = {x = '''a'''', " + dots + " = '1'}\n"), 1);
  EXPECT_EQ(deep_line("a = \"x\\\"\" # it's \"\n" + dots + " = 1\n"), 2);
  EXPECT_EQ(deep_line("t = {x = \"\\\"\", " + dots + " = 1}\n"), 1);
}

TEST(Telegraf, DotsAndBracketsOfTextsAreNoLevels) {
  const std::string many = repeated(".[{", 100);
  const Made made = plugin_of("# " + many + "\nalias = \"" + many + "\" # '" + many +
                              "\nlog_level = '''\n" + many + "''' \ncoils = [\n" +
                              repeated("{name=\"a.b\", address=[1]},\n", 100) + "]\n");
  EXPECT_EQ(made.config["devices"][0]["tags"].size(), 100U);
}
}  // namespace
}  // namespace fxagent
