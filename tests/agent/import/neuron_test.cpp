// Neuron's JSON in its three forms.
#include <gtest/gtest.h>

#include <iterator>

#include "tests/agent/import/outcome.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;

Made neuron(std::string_view text) { return made_of(text, import_neuron); }

constexpr const char* kTags = R"([
  {"name": "Temp", "address": "1!400001", "type": 3, "attribute": 1, "decimal": 0.1, "precision": 0},
  {"name": "Power", "address": "1!300010#BL", "type": 9, "attribute": 3},
  {"name": "On", "address": "1!000004", "type": 11, "attribute": 3},
  {"name": "Bit", "address": "1!400003.15", "type": 11, "attribute": 1},
  {"name": "Text", "address": "1!400020.10H", "type": 13, "attribute": 1},
  {"name": "Other", "address": "2!400001", "type": 4, "attribute": 1, "description": "second unit"},
  {"name": "Big", "address": "1!400040", "type": 10, "attribute": 1},
  {"name": "Bytes", "address": "1!400050", "type": 14, "attribute": 1},
  {"name": "Wrong", "address": "400040", "type": 3, "attribute": 1}])";

TEST(Neuron, NodesWithGroupsAndTags) {
  const Made made = neuron(R"({"nodes": [
      {"name": "mqtt", "plugin": "MQTT", "groups": []},
      {"name": "Line 1", "plugin": "Modbus TCP",
       "params": {"host": "192.0.2.7", "port": 502, "timeout": 3000},
       "groups": [{"group": "fast", "interval": 500, "tags": )" +
                           std::string(kTags) + "}]}]}");
  ASSERT_EQ(made.config["devices"].size(), 2U) << all_of(made.notes);
  EXPECT_EQ(made.config["links"],
            json::parse(R"([{"name":"line1","tcp":{"host":"192.0.2.7","port":502}}])"));
  const json& first = made.config["devices"][0];
  EXPECT_EQ(first["name"], "line_1");
  EXPECT_EQ(first["unit"], 1);
  EXPECT_EQ(first["timeout_ms"], 3000);
  EXPECT_EQ(first["groups"], json::parse(R"([{"name":"fast","interval_ms":500}])"));
  EXPECT_EQ(first["tags"], json::parse(R"([
    {"name":"temp","address":"400001","type":"int16","scale":0.1,"group":"fast"},
    {"name":"power","address":"300010","type":"float32","word_order":"CDAB","group":"fast"},
    {"name":"on","address":"000004","type":"bool","access":"read_write","group":"fast"},
    {"name":"bit","address":"400003.15","type":"bool","group":"fast"},
    {"name":"text","address":"400020","type":"string","length":10,"word_order":"high_first","group":"fast"},
    {"name":"big","address":"400040","type":"float64","group":"fast"}
  ])"))
      << all_of(made.notes);
  EXPECT_EQ(made.config["devices"][1]["name"], "line_1_2");
  EXPECT_EQ(made.config["devices"][1]["unit"], 2);
  expect_note(made, {"not imported: the access of \"power\""});
  expect_note(made, {"left out: Bytes has the type 14"});
  expect_note(made, {"left out: Wrong has the address \"400040\""});
  EXPECT_EQ(made.config["devices"][1]["tags"][0].value("description", ""), "second unit");
}

TEST(Neuron, NoSettingIsDroppedInSilence) {
  const Made made = neuron(R"({"nodes": [{"name": "n", "plugin": "Modbus TCP",
       "params": {"host": "192.0.2.7", "port": 502, "timeout": 3000, "interval": 20, "max_retries": 2},
       "groups": [{"group": "fast", "interval": 500, "tags": [
         {"name": "t", "address": "1!400001", "type": 3, "attribute": 1, "precision": 2, "unit": "bar"},
         {"name": "u", "address": "1!400002", "type": 3, "attribute": 1, "precision": 0}]}]}]})");
  EXPECT_EQ(made.config["devices"][0]["gap_ms"], 20);
  EXPECT_EQ(made.config["devices"][0]["tags"][0]["unit"], "bar");
  expect_note(made, {"not imported: max_retries of the node n"});
  expect_note(made, {"not imported: precision of t"});
  expect_notes(2, made, {"not imported"});
}

// The order of the node for 64 bits is a setting of its own, and "#BL" of a tag goes before it.
TEST(Neuron, ValuesOfFourRegistersHaveTheirTypeAndOrder) {
  const Made made = neuron(R"({"nodes": [{"name": "n", "plugin": "Modbus TCP",
       "params": {"host": "192.0.2.7", "port": 502, "endianess": 1, "endianess_64": 3},
       "groups": [{"group": "g", "interval": 500, "tags": [
         {"name": "a", "address": "1!400001", "type": 7, "attribute": 1},
         {"name": "b", "address": "1!400005#BL", "type": 8, "attribute": 1, "decimal": 0.001},
         {"name": "c", "address": "1!400009", "type": 10, "attribute": 1},
         {"name": "d", "address": "1!400013", "type": 18, "attribute": 1},
         {"name": "e", "address": "1!400017", "type": 5, "attribute": 1}]}]}]})");
  EXPECT_EQ(made.config["devices"][0]["tags"], json::parse(R"([
    {"name":"a","address":"400001","type":"int64","word_order":"DCBA","group":"g"},
    {"name":"b","address":"400005","type":"uint64","word_order":"CDAB","scale":0.001,"group":"g"},
    {"name":"c","address":"400009","type":"float64","word_order":"DCBA","group":"g"},
    {"name":"d","address":"400013","type":"uint64","word_order":"DCBA","group":"g"},
    {"name":"e","address":"400017","type":"int32","word_order":"ABCD","group":"g"}])"));
  EXPECT_EQ(made.left_out, 0U);
}

TEST(Neuron, ListsThatNameTheirDriver) {
  const Made made = neuron(R"({
    "nodes": [{"name": "rtu", "plugin": "Modbus RTU"}],
    "groups": [{"driver": "rtu", "group": "g", "interval": 2000}],
    "tags": [{"driver": "rtu", "group": "g",
              "tags": [{"name": "t", "address": "3!40001", "type": 4, "attribute": 1}]}],
    "settings": [{"node": "rtu", "params": {"device": "/dev/ttyS1", "timeout": 1000}}]})");
  EXPECT_EQ(made.config["devices"][0]["protocol"], "modbus-rtu");
  EXPECT_EQ(made.config["devices"][0]["unit"], 3);
  EXPECT_EQ(made.config["links"][0]["serial"]["path"], "/dev/ttyS1");
}

TEST(Neuron, ATemplate) {
  const Made made = made_of(R"({"name": "rtu template", "plugin": "Modbus RTU", "groups": [
      {"name": "group1", "interval": 2000, "tags": [
        {"name": "tag1", "type": 4, "address": "1!400001", "attribute": 1}]}]})",
                            import_neuron, {"meter", "", "", "/dev/ttyUSB0"});
  EXPECT_EQ(made.config["devices"][0]["name"], "meter");
}

/// A Modbus RTU node with these params and one tag of each kind.
std::string rtu_with(const std::string& params) {
  return R"({"nodes": [{"name": "rtu", "plugin": "Modbus RTU", "params": {)" + params + R"(},
    "groups": [{"group": "g", "interval": 1000, "tags": [
      {"name": "word", "address": "1!400001", "type": 4},
      {"name": "long", "address": "1!400002", "type": 5},
      {"name": "real", "address": "1!400004#BB", "type": 9},
      {"name": "text", "address": "1!400020.10", "type": 13},
      {"name": "low", "address": "1!400030.10L", "type": 13}]}]}]})";
}

TEST(Neuron, AStringHasItsHighByteFirstUnlessItSaysL) {
  const Made made = neuron(rtu_with(""));
  const json& tags = made.config["devices"][0]["tags"];
  EXPECT_EQ(tags[3]["word_order"], "high_first");
  EXPECT_EQ(tags[4]["word_order"], "low_first");
}

TEST(Neuron, TheNodesByteOrderIsThatOfTagsWithoutOne) {
  const std::vector<const char*> orders{"ABCD", "BADC", "DCBA", "CDAB"};
  for (std::size_t code = 1; code <= orders.size(); ++code) {
    const Made made = neuron(rtu_with("\"endianess\": " + std::to_string(code)));
    const json& device = made.config["devices"][0];
    EXPECT_FALSE(device.contains("byte_order"));
    EXPECT_FALSE(device["tags"][0].contains("word_order"));
    EXPECT_EQ(device["tags"][1]["word_order"], orders[code - 1]);
    EXPECT_EQ(device["tags"][2]["word_order"], "DCBA");
    EXPECT_EQ(device["tags"][3]["word_order"], "high_first");
  }
  const Made made = neuron(rtu_with("\"endianess\": 7"));
  expect_note(made, {"not imported: endianess 7"});
}

TEST(Neuron, TheSerialLineIsWhatItsCodesMean) {
  const auto serial_of = [](const std::string& params) {
    const Made made = neuron(rtu_with("\"device\": \"/dev/ttyS1\"" + params));
    return made.config["links"][0]["serial"];
  };
  EXPECT_EQ(serial_of(""), json::parse(R"({"path": "/dev/ttyS1", "baud": 9600, "data_bits": 8,
      "parity": "none", "stop_bits": 1})"));
  EXPECT_EQ(serial_of(R"(, "baud": 0, "parity": 2, "stop": 1, "data": 3)"),
            json::parse(R"({"path": "/dev/ttyS1", "baud": 115200, "data_bits": 8,
      "parity": "even", "stop_bits": 2})"));
  const int bauds[] = {115200, 57600, 38400, 19200, 9600, 4800, 2400,
                       1800,   1200,  600,   300,   200,  150};
  for (std::size_t code = 0; code < std::size(bauds); ++code)
    EXPECT_EQ(serial_of(", \"baud\": " + std::to_string(code))["baud"], bauds[code]);
  EXPECT_EQ(serial_of(R"(, "baud": 3, "parity": 1)")["parity"], "odd");
  const Made made = neuron(rtu_with(R"("device": "/dev/ttyS1", "baud": 99, "parity": 3)"));
  expect_note(made, {"not imported: baud 99"});
  expect_note(made, {"not imported: parity 3"});
  EXPECT_FALSE(made.config["links"][0]["serial"].contains("baud"));
}

TEST(Neuron, WhereItWaitsForTheDeviceTheLinkIsAPlaceholder) {
  const Made made = neuron(R"({"nodes": [{"name": "n", "plugin": "Modbus TCP",
       "params": {"host": "0.0.0.0", "port": 5000, "connection_mode": 1, "address_base": 0},
       "groups": [{"group": "g", "tags": [{"name": "t", "address": "1!400001", "type": 4}]}]}]})");
  EXPECT_EQ(made.config["links"][0]["tcp"]["host"], "192.0.2.1");
  expect_note(made, {"the device connects to Neuron"});
  expect_note(made, {"its addresses count from 0"});
}

TEST(Neuron, AnotherProtocolIsTold) {
  const Made made =
      outcome_of(R"({"nodes": [{"name": "s7", "plugin": "Siemens S7 ISOTCP", "groups": [
      {"group": "g", "interval": 100, "tags": [{"name": "t", "address": "DB1.1", "type": 3}]}]}]})",
                 import_neuron);
  EXPECT_TRUE(made.config.is_null());
  expect_note(made, {"left out: the node s7", "Siemens S7 ISOTCP"});
}

TEST(Neuron, IsToldFromOtherJson) {
  EXPECT_TRUE(is_neuron(R"({"nodes": [{"name": "a", "plugin": "b"}]})"));
  EXPECT_FALSE(is_neuron(R"({"nodes": []})"));
  EXPECT_FALSE(is_neuron("{"));
  EXPECT_FALSE(import_neuron("{}", {}));
  EXPECT_EQ(error_of(import_neuron("{\n,", {})).line, 2);
}

/// A node of the given plugin at 192.0.2.7 with these tags.
Made node_of(const std::string& plugin, const std::string& tags, const std::string& model) {
  return made_of(R"({"nodes": [{"name": "n", "plugin": ")" + plugin + R"(",
       "params": {"host": "192.0.2.7", "port": 2000},
       "groups": [{"group": "g", "tags": [)" +
                     tags + "]}]}]}",
                 import_neuron, {"", "", model, ""});
}

TEST(Neuron, PluginsOfMcProtocolAreOurs) {
  for (const char* plugin : {"Mitsubishi 3E", "qna3e"}) {
    const Made made = node_of(plugin, R"(
        {"name": "speed", "address": "D100", "type": 3, "attribute": 3},
        {"name": "bit5", "address": "D20.5", "type": 11},
        {"name": "bit12", "address": "D20.12", "type": 11},
        {"name": "part", "address": "D1000.16L", "type": 13},
        {"name": "order", "address": "D1100.16", "type": 13},
        {"name": "run_hours", "address": "SN5", "type": 4},
        {"name": "done", "address": "SS5", "type": 11},
        {"name": "input", "address": "X1F", "type": 11})",
                              "Q");
    const json& device = made.config["devices"][0];
    EXPECT_EQ(device["protocol"], "mc-3e");
    EXPECT_EQ(made.config["links"][0]["tcp"], json::parse(R"({"host":"192.0.2.7","port":2000})"));
    EXPECT_EQ(device["tags"], json::parse(R"([
      {"name":"speed","address":"D100","type":"int16","access":"read_write","group":"g"},
      {"name":"bit5","address":"D20.5","type":"bool","group":"g"},
      {"name":"bit12","address":"D20.C","type":"bool","group":"g"},
      {"name":"part","address":"D1000","type":"string","length":16,"word_order":"low_first","group":"g"},
      {"name":"order","address":"D1100","type":"string","length":16,"word_order":"high_first","group":"g"},
      {"name":"run_hours","address":"STN5","type":"uint16","group":"g"},
      {"name":"done","address":"STS5","type":"bool","group":"g"},
      {"name":"input","address":"X1F","type":"bool","group":"g"}])"))
        << all_of(made.notes);
  }
  for (const char* plugin : {"Mitsubishi 1E", "a1e"}) {
    const Made made = node_of(plugin, R"({"name": "t", "address": "D7", "type": 4})", "FX3U");
    EXPECT_EQ(made.config["devices"][0]["protocol"], "mc-1e");
  }
}

constexpr const char* kSheet =
    "group,name,address,attribute,type,description,decimal,precision\n"
    "fast,Temp,1!400010,Read,INT16,,0.1,\n"
    "slow,Set,1!400020,Read Write,FLOAT,,,\n"
    "fast,Run,2!000004,Read,BIT,,,\n"
    "fast,Odd,1!400001,Read,INT8,,,\n";

TEST(Neuron, TheSheetOfTagsIsReadAsCsv) {
  EXPECT_TRUE(is_neuron(kSheet));
  EXPECT_FALSE(is_tag_csv(kSheet));
  const Made made = made_of(kSheet, import_neuron, {"meter", "", "", "192.0.2.7:502"});
  ASSERT_EQ(made.config["devices"].size(), 2U);
  const json& device = made.config["devices"][0];
  EXPECT_EQ(device["name"], "meter");
  EXPECT_EQ(device["protocol"], "modbus-tcp");
  EXPECT_EQ(device["groups"], json::parse(R"([{"name":"fast"},{"name":"slow"}])"));
  EXPECT_EQ(device["tags"], json::parse(R"([
    {"name":"temp","address":"400010","type":"int16","scale":0.1,"group":"fast"},
    {"name":"set","address":"400020","type":"float32","access":"read_write","group":"slow"}])"));
  EXPECT_EQ(made.config["devices"][1]["unit"], 2);
  expect_note(made, {"5: left out: Odd"});
  EXPECT_EQ(made.left_out, 1U);
}

TEST(Neuron, ASheetWithoutSlavesAsksForTheProtocol) {
  constexpr const char* kDevices = "name,address,attribute,type\nspeed,D100,Read,INT16\n";
  expect_says(error_of(import_neuron(kDevices, {})).text, "--protocol to mc-3e");
  const Made made = made_of(kDevices, import_neuron, {"", "mc-3e", "FX5U", "192.0.2.7:5000"});
  EXPECT_EQ(made.config["devices"][0]["tags"][0]["address"], "D100");
  EXPECT_EQ(made.config["devices"][0]["groups"][0]["name"], "default");
}

}  // namespace
}  // namespace fxagent
