// Compares config/agent.schema.json, which editors use, with the loader, which decides.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <valijson/adapters/nlohmann_json_adapter.hpp>
#include <valijson/schema.hpp>
#include <valijson/schema_parser.hpp>
#include <valijson/validation_results.hpp>
#include <valijson/validator.hpp>

#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;
using Adapter = valijson::adapters::NlohmannJsonAdapter;

json read_json(const char* path) {
  std::ifstream file(path);
  return json::parse(file);
}

const json& schema_text() {
  static const json text = read_json(FXAGENT_CONFIG_DIR "/agent.schema.json");
  return text;
}

/// Returns the schema's errors; empty if it accepts.
std::string schema_errors(const json& document) {
  static const auto schema = [] {
    auto parsed = std::make_unique<valijson::Schema>();
    valijson::SchemaParser().populateSchema(Adapter(schema_text()), *parsed);
    return parsed;
  }();
  valijson::Validator validator(valijson::Validator::kStrongTypes);
  valijson::ValidationResults results;
  if (validator.validate(*schema, Adapter(document), &results)) return {};
  std::string text = "refused: ";
  valijson::ValidationResults::Error error;
  while (results.popError(error)) {
    for (const std::string& place : error.context) text += place;
    text += " " + error.description + "\n";
  }
  return text;
}

struct Snippet {
  std::string pointer;
  std::string value;  ///< JSON; empty: removes the member
};

/// Reads them from {"/pointer": [value, ...], ..., "without": [pointer, ...]}.
std::vector<Snippet> snippets(const char* table) {
  std::vector<Snippet> all;
  const json places = json::parse(table);
  for (const auto& [place, values] : places.items())
    for (const json& value : values)
      all.push_back(place == "without" ? Snippet{value.get<std::string>(), ""}
                                       : Snippet{place, value.dump()});
  return all;
}

json spoiled(const Snippet& snippet) {
  return json::parse(snippet.value.empty() ? without(snippet.pointer)
                                           : changed(snippet.pointer, snippet.value));
}

std::string told(const Snippet& snippet) {
  return snippet.pointer + " = " + (snippet.value.empty() ? "(none)" : snippet.value);
}

/// Expects both to accept each of the plants that `make` makes.
void expect_right(json (*make)(const Snippet&), const char* table,
                  const Environment& from = environment()) {
  for (const Snippet& snippet : snippets(table)) {
    EXPECT_EQ(schema_errors(make(snippet)), "") << told(snippet);
    EXPECT_EQ(listed(errors_of(make(snippet).dump(), from)), "") << told(snippet);
  }
}

/// Expects both to refuse each of them.
void expect_wrong(json (*make)(const Snippet&), const char* table) {
  for (const Snippet& snippet : snippets(table)) {
    EXPECT_NE(schema_errors(make(snippet)), "") << told(snippet);
    EXPECT_FALSE(errors_of(make(snippet).dump()).empty()) << told(snippet);
  }
}

TEST(ConfigSchema, SmallPlantAndExamplesPassBoth) {
  EXPECT_EQ(schema_errors(small_plant()), "");
  for (const char* name : {"/agent.example.json", "/fx5u-modbus.example.json"}) {
    const json example = read_json((std::string(FXAGENT_CONFIG_DIR) + name).c_str());
    EXPECT_EQ(schema_errors(example), "") << name;
    const Config config = good(example.dump());
    EXPECT_TRUE(config.warnings.empty()) << name << ": " << config.warnings.front();
  }
}

TEST(ConfigSchema, WhatIsRightPassesBoth) {
  expect_right(spoiled, R"({
    "without": ["/agent/root", "/store", "/links/1/line_baud", "/devices/0/model",
      "/devices/0/groups/0/interval_ms"],
    "/$schema": ["https://example.org/agent.schema.json"],
    "/agent/id": ["0_-z"], "/agent/root": ["Werk 1/Ä"],
    "/mqtt/servers": [["mqtts://a.b-c:8883", "mqtt://[::1]:1", "mqtt://10.0.0.1"]],
    "/mqtt/version": ["3.1.1"], "/mqtt/qos": [0], "/mqtt/keep_alive_s": [65535],
    "/mqtt/tls": [{}, {"cert_file": "a", "key_file": "b"}], "/mqtt/password_env": ["P"],
    "/mqtt": [{"servers": ["mqtt://a"], "password": "x", "allow_plain_secret": true}],
    "/mqtt/allow_plain_secret": [false],
    "/store/sync": ["always"], "/store/max_bytes": [65536],
    "/links/0/serial": [
      {"path": "/dev/a", "baud": 50, "data_bits": 8, "parity": "none", "stop_bits": 2}],
    "/links/0/serial/rs485": [{},
      {"rts_on_send": false, "delay_before_ms": 1, "delay_after_ms": 100}],
    "/links/1/parity": ["odd"], "/links/1/poll_share_percent": [90],
    "/links/2": [{"name": "l3", "udp": {"host": "a", "port": 5007}},
      {"name": "l3", "udp": {"host": "::1", "port": 1, "local_port": 65535}}],
    "/links/1/tcp/host": ["0.0.0.0", "192.168.100.255", "10.0.0.1.example", "3com"],
    "/devices": [[]],
    "/devices/0/model": ["auto"], "/devices/0/enquire": ["never"],
    "/devices/0/command_set": ["classic"], "/devices/0/max_block_bytes": [2, 254],
    "/devices/0/echo": [true], "/devices/0/timeout_ms": [600000],
    "/devices/0/groups/0/interval_ms": [0], "/devices/0/groups/0/publish": ["on_change"],
    "/devices/0/tags": [[]], "/devices/0/tags/0/address": ["d100.a", "K4M0", "TN5", "T5"],
    "/devices/1": [
      {"name": "press2", "link": "gw1", "protocol": "fx-computer-link", "model": "FX3U",
       "tags": [{"name": "a", "address": "R0"}, {"name": "b", "address": "r32767.f"}],
       "commands": {"allow": ["R0-R9", "R10"]}}],
    "/devices/0/tags/0/unit": [""], "/devices/0/tags/0/count": [1],
    "/devices/0/tags/0": [{"name": "t", "address": "D0", "type": "string", "length": 9}],
    "/devices/0/tags/0/scale": [-0.1], "/devices/0/tags/0/deadband": [0],
    "/devices/0/tags/0/word_order": ["high_first", "CDAB"], "/devices/0/tags/0/access": ["read_write"],
    "/devices/0/commands": [{}], "/devices/0/commands/allow": [["TN0-TN5", "CN200", "y0-y7"],
      ["D0-100", "M0 - M9", "Y0 .. 17", " TN0..5 "]],
    "/devices/0/commands/queue": [10000]})");
}

TEST(ConfigSchema, VariablesInFreeTextPassBoth) {
  const auto from = environment({{"V", "1"}});
  expect_right(spoiled, R"({
    "/agent/id": ["edge${V}"], "/agent/root": ["${V}/a"],
    "/mqtt/servers/0": ["mqtt://a${V}"], "/mqtt/username": ["${V}"],
    "/store/path": ["/s/${V}"],
    "/links/0/serial/path": ["/dev/tty${V}"],
    "/links/1/tcp/host": ["a${V}"],
    "/devices/0/tags/0/address": ["D${V}"],
    "/devices/0/commands/allow/0": ["M${V}-M5"]})",
               from);
}

TEST(ConfigSchema, WhatIsWrongFailsBoth) {
  expect_wrong(spoiled, R"({
    "without": ["/agent", "/mqtt", "/links", "/devices", "/agent/id", "/store/path",
      "/devices/0/protocol", "/devices/0/groups/0/name", "/devices/0/tags/0/address"],
    "/colour": ["red"],
    "/$schema": [5],
    "/agent/id": ["Edge 7", ""], "/agent/root": ["/a", "a/", "a//b", "a/+", "$SYS"],
    "/agent/name": ["a"],
    "/mqtt/servers": [[], "mqtt://a"],
    "/mqtt/servers/0": ["tcp://a", "mqtt://u:p@a", "mqtt://a/b", "mqtt://"],
    "/mqtt/version": ["4", 5], "/mqtt/qos": [2, "1"], "/mqtt/keep_alive_s": [0, 1.5],
    "/mqtt/password": [5, "", "a\nb"], "/mqtt/allow_plain_secret": [1],
    "/mqtt": [
      {"servers": ["mqtt://a"], "password": "x", "password_env": "P", "allow_plain_secret": true},
      {"servers": ["mqtt://a"], "version": "3.1.1", "password": "x", "allow_plain_secret": true}],
    "/mqtt/username": ["", "a\nb"], "/mqtt/tls": [{"cert_file": "a"}, null],
    "/store/max_bytes": [65535], "/store/max_age_h": [0], "/store/sync": ["never"],
    "/store/audit_max_bytes": [65535], "/store/audit_max_age_h": [0],
    "/links/0": [{"name": "line1"}], "/links/0/tcp": [{"host": "a", "port": 1}],
    "/links/0/line_baud": [9600], "/links/0/poll_share_percent": [91],
    "/links/0/parity": ["even"], "/links/0/serial/baud": [49], "/links/0/serial/data_bits": [5],
    "/links/0/serial/parity": ["mark"], "/links/0/serial/stop_bits": [3],
    "/links/0/serial/rs485": [true, {"rts": true}, {"delay_before_ms": 101}],
    "/links/0/serial/path": [""],
    "/links/1": [{"name": "gw1", "tcp": {"host": "a", "port": 1}, "data_bits": 8}],
    "/links/1/tcp/port": [65536],
    "/links/1/tcp/host": ["a/b", "[::1]", "127.000.000.010", "127.1", "192.168.1.300", "256.1.1.1", "1.2.3.4.",
      "1.2.3.4.5", "1.2.3.04"],
    "/links/1/udp": [{"host": "a", "port": 1}],
    "/links/2": [{"name": "l3", "udp": {"host": "a"}},
      {"name": "l3", "udp": {"host": "a/b", "port": 1}},
      {"name": "l3", "udp": {"host": "a", "port": 1, "local_port": 0}},
      {"name": "l3", "udp": {"host": "a", "port": 1, "mode": "x"}},
      {"name": "l3", "udp": {"host": "a", "port": 1}, "line_baud": 9600}],
    "/devices/0/protocol": ["mc-3e"], "/devices/0/model": ["FX5U"], "/devices/0/station": [1],
    "/devices/0/retries": [-1], "/devices/0/timeout_ms": ["1s"], "/devices/0/echo": [0],
    "/devices/0/max_block_bytes": [255], "/devices/0/enquire": ["sometimes"],
    "/devices/0/groups/0/publish": ["changed"], "/devices/0/groups/0/interval_ms": [-1],
    "/devices/0/tags/0/name": ["Temp"], "/devices/0/tags/0/address": [100, "X8", "hr:0", "M0.1"],
    "/devices/0/tags/0/type": ["float", "string"], "/devices/0/tags/0/length": [5],
    "/devices/0/tags/0/count": [0], "/devices/0/tags/0/word_order": ["BADC"],
    "/devices/0/tags/0/scale": [0, "0.1"], "/devices/0/tags/0/deadband": [-0.5],
    "/devices/0/tags/0/access": ["write"], "/devices/0/tags/1/scale": [2],
    "/devices/0/tags/1/deadband": [2], "/devices/0/tags/1/word_order": ["low_first"],
    "/devices/0/commands/allow/0": ["T5", "K4M0", "M0-", "Y0-8", "M0-X5", "M 0",
      "M0\t-\tM9", "\tM0"],
    "/devices/0/commands/queue": [0],
    "/devices/0/commands/verify": ["yes"], "/devices/0/commands/max_expiry_s": [0]})");
}

TEST(ConfigSchema, WhatOnlyTheLoaderCanFindFailsThere) {
  for (const Snippet& snippet : snippets(R"({
    "/mqtt/username": ["${FX_NO_SUCH}"], "/mqtt/password": ["x"],
    "/mqtt/servers/0": ["mqtt://a:0", "mqtt://127.000.000.010"], "/links/1/tcp/host": ["0x7f000001"],
    "/links/1/name": ["line1"],
    "/links/2": [{"name": "l3", "serial": {"path": "/dev/ttyUSB0"}}],
    "/devices/0/link": ["line2"],
    "/devices/1/name": ["press1"],
    "/devices/0/groups/1": [{"name": "fast"}],
    "/devices/0/tags/0/group": ["fats"], "/devices/0/tags/1/name": ["temp"],
    "/devices/0/tags/0/address": ["D9000"],
    "/devices/0/tags/0": [{"name": "t", "address": "D7999", "count": 2},
      {"name": "t", "address": "M0", "type": "int16"},
      {"name": "t", "address": "M0", "deadband": 1},
      {"name": "t", "address": "D0", "min": 2, "max": 1},
      {"name": "t", "address": "D0.F", "access": "read_write"},
      {"name": "t", "address": "M8037", "access": "read_write"}],
    "/devices/0/commands/allow/0": ["M8034", "M9-M0"],
    "/devices/0/commands": [{"default_expiry_s": 9, "max_expiry_s": 8}]})")) {
    EXPECT_EQ(schema_errors(spoiled(snippet)), "") << told(snippet);
    EXPECT_FALSE(errors_of(spoiled(snippet).dump()).empty()) << told(snippet);
  }
}

/// The small plant with its last device replaced by a Modbus device, with one error.
json modbus_plant(const Snippet& snippet) {
  json plant = small_plant();
  plant["devices"][1] = json::parse(R"({
    "name": "mixer", "link": "gw1", "protocol": "modbus-tcp",
    "tags": [{"name": "level", "address": "hr:100"}],
    "commands": {"allow": ["co:1-co:7"]}})");
  plant[json::json_pointer(snippet.pointer)] = json::parse(snippet.value);
  return plant;
}

TEST(ConfigSchema, WhatIsRightOnModbusPassesBoth) {
  expect_right(modbus_plant, R"({
    "/devices/1/protocol": ["modbus-rtu", "modbus-ascii"], "/devices/1/model": ["auto"],
    "/devices/1/unit": [255], "/devices/1/max_read": [1], "/devices/1/max_gap": [0],
    "/devices/1/byte_order": ["DCBA"], "/devices/1/address_base": [1],
    "/devices/1/allow_read_modify_write": [true], "/devices/1/max_block_bytes": [100],
    "/devices/1/echo": [true],
    "/devices/1/tags/0/address": ["IR:0x1f", "hr:7.15", "co:65535", "di:1", "40101", "300001.0",
      "00001"],
    "/devices/1/tags/0/word_order": ["BADC", "low_first"],
    "/devices/1/tags/0/states": [{"0": "idle", "-17": "jam"}],
    "/devices/1/tags/0/description": [""],
    "/devices/1/commands/allow": [["hr:1-hr:2", "hr:1-0x20", "40001-40009", "co:3"],
      ["hr:1 - 20", "40001 .. 40009", "40001-hr:20", " co:3 "]]})");
}

TEST(ConfigSchema, WhatIsWrongOnModbusFailsBoth) {
  expect_wrong(modbus_plant, R"({
    "/devices/1/model": ["FX3U"], "/devices/1/unit": [256, "1"], "/devices/1/max_read": [126],
    "/devices/1/max_gap": [-1], "/devices/1/byte_order": ["low_first"],
    "/devices/1/address_base": [2], "/devices/1/allow_read_modify_write": [1],
    "/devices/1/enquire": ["never"], "/devices/1/station": [1],
    "/devices/1/tags/0/address": ["D100", "hr100", "hr:7.16", "co:7.1", "20001", "4001"],
    "/devices/1/tags/0/word_order": ["DACB"],
    "/devices/1/tags/0/states": [{"00": "idle"}, {"0": ""}, ["idle"]],
    "/devices/1/tags/0/description": [1], "/devices/1/tags/0/scale": [0],
    "/devices/1/tags/0/length": [5],
    "/devices/1/commands/allow/0": ["M0", "hr:1.3", "hr:1-", "hr:1-40009",
      "40001-9"]})");
}

/// The small plant with its last device replaced by a 1E device, with one error.
json mc_plant(const Snippet& snippet) {
  json plant = small_plant();
  plant["links"][1].erase("line_baud");
  plant["devices"][1] = json::parse(R"({
    "name": "press2", "link": "gw1", "protocol": "mc-1e", "model": "Q",
    "tags": [{"name": "level", "address": "D100"}],
    "commands": {"allow": ["M1-M7"]}})");
  plant[json::json_pointer(snippet.pointer)] = json::parse(snippet.value);
  return plant;
}

TEST(ConfigSchema, WhatIsRightOf1EFramesPassesBoth) {
  expect_right(mc_plant, R"({
    "/devices/1/model": ["FX3GE", "auto"], "/devices/1/code": ["ascii"], "/devices/1/pc": [0],
    "/devices/1/monitoring_timer_ms": [250, 60000],
    "/devices/1/tags/0/address": ["X1F", "b0ff", "W1A.F", "K8Y0", "F5", "TC5", "T5"],
    "/devices/1/tags/0/word_order": ["high_first"],
    "/devices/1/commands/allow": [["W0..W1F", "TN5", "Y0-YF"],
      ["D0-100", "WA0 - 1FF", "Y0..1F", " M5 "]]})");
}

TEST(ConfigSchema, WhatIsWrongOf1EFramesFailsBoth) {
  expect_wrong(mc_plant, R"({
    "/devices/1/model": ["FX5U"], "/devices/1/code": ["text"], "/devices/1/pc": [256],
    "/devices/1/monitoring_timer_ms": [0, 60001], "/devices/1/station": [1],
    "/devices/1/network": [1],
    "/devices/1/tags/0/address": ["hr:0", "XG"], "/devices/1/tags/0/word_order": ["BADC"],
    "/devices/1/commands/allow/0": ["K4M0", "M0-", "M0-M"]})");
}

// A variable instead of a fixed word: the loader substitutes it, an editor marks it as an error.
TEST(ConfigSchema, VariableInPlaceOfAWordIsTheOneThingOnlyTheSchemaRefuses) {
  const Snippet snippet{"/devices/0/model", R"("${MODEL}")"};
  EXPECT_NE(schema_errors(spoiled(snippet)), "");
  EXPECT_TRUE(errors_of(spoiled(snippet).dump(), environment({{"MODEL", "FX3U"}})).empty());
}

/// The small plant with a template and two entries of it, with one error.
json many_plant(const Snippet& snippet) {
  json plant = small_plant();
  plant["templates"] = json::parse(R"({"meter": {
    "protocol": "modbus-tcp", "link": "gw1", "timeout_ms": 300,
    "groups": [{"name": "g{n}", "interval_ms": "{n}"}],
    "tags": [{"name": "t{n}", "address": "hr:{n}", "group": "g{n}", "scale": "{n}"}],
    "commands": {"allow": ["hr:{n}"], "queue": "{n}"}}})");
  plant["devices"] = json::parse(R"([
    {"template": "meter", "name": "m{n}", "n": "1-3", "unit": "{n}"},
    {"template": "meter", "name": "m{n}", "n": [4, "5"], "unit": "{n}",
     "tags": [{"name": "own", "address": "co:1"}]}])");
  if (!snippet.value.empty())
    plant[json::json_pointer(snippet.pointer)] = json::parse(snippet.value);
  return plant;
}

TEST(ConfigSchema, WhatIsRightInTemplatesPassesBoth) {
  expect_right(many_plant, R"({
    "without": [""],
    "/templates/unused": [{"model": "FX3U"}],
    "/devices/0/n": ["01-02,07", "1 - 2, 7 .. 8 ", " 6 "], "/devices/0/timeout_ms": [500],
    "/templates/meter/tags/0/type": ["int32"],
    "/templates/meter/tags/0/description": ["Meter {n}"],
    "/templates/meter/tags/0/states": [{"0": "{n}"}], "/templates/meter/byte_order": ["DCBA"],
    "/devices/2": [
      {"name": "p{n}", "n": ["a", "b"], "link": "line1", "protocol": "fx-computer-link",
       "model": "FX3U", "tags": [{"name": "t", "address": "D0"}]}]})");
}

TEST(ConfigSchema, WhatIsWrongInTemplatesFailsBoth) {
  expect_wrong(many_plant, R"({
    "/templates": [[]],
    "/templates/A": [{}],
    "/templates/meter/template": ["meter"], "/templates/meter/n": ["1-2"],
    "/templates/meter/colour": [1], "/templates/meter/protocol": ["mc"],
    "/templates/meter/timeout_ms": ["x"], "/templates/meter/tags/0/colour": [1],
    "/templates/meter/tags/0/type": ["float"], "/templates/meter/groups/0/publish": ["x"],
    "/templates/meter/commands/queue": [0],
    "/devices/0/n": [5, "a-b", "", "1,", "1 2", "1-", [], [1.5]], "/devices/0/colour": [1], "/devices/0/template": [5],
    "/devices/0/unit": [256]})");
}

}  // namespace
}  // namespace fxagent
