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
  const char* pointer;
  const char* value;  ///< JSON; null pointer: removes the member
};

json spoiled(const Snippet& snippet) {
  return json::parse(snippet.value == nullptr ? without(snippet.pointer)
                                              : changed(snippet.pointer, snippet.value));
}

std::string told(const Snippet& snippet) {
  return std::string(snippet.pointer) + " = " + (snippet.value ? snippet.value : "(none)");
}

/// Expects both to accept each of the plants that `make` makes.
void expect_right(json (*make)(const Snippet&), const std::vector<Snippet>& snippets,
                  const Environment& from = environment()) {
  for (const Snippet& snippet : snippets) {
    EXPECT_EQ(schema_errors(make(snippet)), "") << told(snippet);
    EXPECT_EQ(listed(errors_of(make(snippet).dump(), from)), "") << told(snippet);
  }
}

/// Expects both to refuse each of them.
void expect_wrong(json (*make)(const Snippet&), const std::vector<Snippet>& snippets) {
  for (const Snippet& snippet : snippets) {
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
  expect_right(
      spoiled,
      {{"/$schema", R"("https://example.org/agent.schema.json")"},
       {"/agent/id", R"("0_-z")"},
       {"/agent/root", nullptr},
       {"/agent/root", R"("Werk 1/Ä")"},
       {"/store", nullptr},
       {"/mqtt/servers", R"(["mqtts://a.b-c:8883", "mqtt://[::1]:1", "mqtt://10.0.0.1"])"},
       {"/mqtt/version", R"("3.1.1")"},
       {"/mqtt/qos", "0"},
       {"/mqtt/keep_alive_s", "65535"},
       {"/mqtt/tls", "{}"},
       {"/mqtt/tls", R"({"cert_file": "a", "key_file": "b"})"},
       {"/mqtt/password_env", R"("P")"},
       {"/mqtt", R"({"servers": ["mqtt://a"], "password": "x", "allow_plain_secret": true})"},
       {"/mqtt/allow_plain_secret", "false"},
       {"/store/sync", R"("always")"},
       {"/store/max_bytes", "65536"},
       {"/links/0/serial",
        R"({"path": "/dev/a", "baud": 50, "data_bits": 8, "parity": "none", "stop_bits": 2})"},
       {"/links/0/serial/rs485", "{}"},
       {"/links/0/serial/rs485",
        R"({"rts_on_send": false, "delay_before_ms": 1, "delay_after_ms": 100})"},
       {"/links/1/parity", R"("odd")"},
       {"/links/1/line_baud", nullptr},
       {"/links/1/poll_share_percent", "90"},
       {"/links/2", R"({"name": "l3", "udp": {"host": "a", "port": 5007}})"},
       {"/links/2", R"({"name": "l3", "udp": {"host": "::1", "port": 1, "local_port": 65535}})"},
       {"/devices", "[]"},
       {"/devices/0/model", nullptr},
       {"/devices/0/model", R"("auto")"},
       {"/devices/0/enquire", R"("never")"},
       {"/devices/0/command_set", R"("classic")"},
       {"/devices/0/max_block_bytes", "2"},
       {"/devices/0/max_block_bytes", "254"},
       {"/devices/0/echo", "true"},
       {"/devices/0/timeout_ms", "600000"},
       {"/devices/0/groups/0/interval_ms", nullptr},
       {"/devices/0/groups/0/interval_ms", "0"},
       {"/devices/0/groups/0/publish", R"("on_change")"},
       {"/devices/0/tags", "[]"},
       {"/devices/0/tags/0/address", R"("d100.a")"},
       {"/devices/0/tags/0/address", R"("K4M0")"},
       {"/devices/0/tags/0/address", R"("TN5")"},
       {"/devices/0/tags/0/address", R"("T5")"},
       {"/devices/1", R"({"name": "press2", "link": "gw1", "protocol": "fx-computer-link",
                              "model": "FX3U",
                              "tags": [{"name": "a", "address": "R0"},
                                       {"name": "b", "address": "r32767.f"}],
                              "commands": {"allow": ["R0-R9", "R10"]}})"},
       {"/devices/0/tags/0/unit", R"("")"},
       {"/devices/0/tags/0/count", "1"},
       {"/devices/0/tags/0", R"({"name": "t", "address": "D0", "type": "string", "length": 9})"},
       {"/devices/0/tags/0/scale", "-0.1"},
       {"/devices/0/tags/0/deadband", "0"},
       {"/devices/0/tags/0/word_order", R"("high_first")"},
       {"/devices/0/tags/0/access", R"("read_write")"},
       {"/devices/0/commands", "{}"},
       {"/devices/0/commands/allow", R"(["TN0-TN5", "CN200", "y0-y7"])"},
       {"/devices/0/commands/queue", "10000"}});
}

TEST(ConfigSchema, VariablesInFreeTextPassBoth) {
  const auto from = environment({{"V", "1"}});
  expect_right(spoiled,
               {{"/agent/id", R"("edge${V}")"},
                {"/agent/root", R"("${V}/a")"},
                {"/mqtt/servers/0", R"("mqtt://${V}")"},
                {"/mqtt/username", R"("${V}")"},
                {"/store/path", R"("/s/${V}")"},
                {"/links/0/serial/path", R"("/dev/tty${V}")"},
                {"/links/1/tcp/host", R"("a${V}")"},
                {"/devices/0/tags/0/address", R"("D${V}")"},
                {"/devices/0/commands/allow/0", R"("M${V}-M5")"}},
               from);
}

TEST(ConfigSchema, WhatIsWrongFailsBoth) {
  expect_wrong(
      spoiled,
      {{"/colour", R"("red")"},
       {"/$schema", "5"},
       {"/agent", nullptr},
       {"/mqtt", nullptr},
       {"/links", nullptr},
       {"/devices", nullptr},
       {"/agent/id", nullptr},
       {"/agent/id", R"("Edge 7")"},
       {"/agent/id", R"("")"},
       {"/agent/root", R"("/a")"},
       {"/agent/root", R"("a/")"},
       {"/agent/root", R"("a//b")"},
       {"/agent/root", R"("a/+")"},
       {"/agent/root", R"("$SYS")"},
       {"/agent/name", R"("a")"},
       {"/mqtt/servers", "[]"},
       {"/mqtt/servers", R"("mqtt://a")"},
       {"/mqtt/servers/0", R"("tcp://a")"},
       {"/mqtt/servers/0", R"("mqtt://u:p@a")"},
       {"/mqtt/servers/0", R"("mqtt://a/b")"},
       {"/mqtt/servers/0", R"("mqtt://")"},
       {"/mqtt/version", R"("4")"},
       {"/mqtt/version", "5"},
       {"/mqtt/qos", "2"},
       {"/mqtt/qos", R"("1")"},
       {"/mqtt/keep_alive_s", "0"},
       {"/mqtt/keep_alive_s", "1.5"},
       {"/mqtt/password", "5"},
       {"/mqtt/password", R"("")"},
       {"/mqtt/password", R"("a\nb")"},
       {"/mqtt/allow_plain_secret", "1"},
       {"/mqtt", R"({"servers": ["mqtt://a"], "password": "x", "password_env": "P",
                         "allow_plain_secret": true})"},
       {"/mqtt", R"({"servers": ["mqtt://a"], "version": "3.1.1", "password": "x",
                         "allow_plain_secret": true})"},
       {"/mqtt/username", R"("")"},
       {"/mqtt/username", R"("a\nb")"},
       {"/mqtt/tls", R"({"cert_file": "a"})"},
       {"/mqtt/tls", "null"},
       {"/store/path", nullptr},
       {"/store/max_bytes", "65535"},
       {"/store/max_age_h", "0"},
       {"/store/sync", R"("never")"},
       {"/store/audit_max_bytes", "65535"},
       {"/store/audit_max_age_h", "0"},
       {"/links/0", R"({"name": "line1"})"},
       {"/links/0/tcp", R"({"host": "a", "port": 1})"},
       {"/links/0/line_baud", "9600"},
       {"/links/0/poll_share_percent", "91"},
       {"/links/0/parity", R"("even")"},
       {"/links/0/serial/baud", "49"},
       {"/links/0/serial/data_bits", "5"},
       {"/links/0/serial/parity", R"("mark")"},
       {"/links/0/serial/stop_bits", "3"},
       {"/links/0/serial/rs485", "true"},
       {"/links/0/serial/rs485", R"({"rts": true})"},
       {"/links/0/serial/rs485", R"({"delay_before_ms": 101})"},
       {"/links/0/serial/path", R"("")"},
       {"/links/1", R"({"name": "gw1", "tcp": {"host": "a", "port": 1}, "data_bits": 8})"},
       {"/links/1/tcp/port", "65536"},
       {"/links/1/tcp/host", R"("a/b")"},
       {"/links/1/udp", R"({"host": "a", "port": 1})"},
       {"/links/2", R"({"name": "l3", "udp": {"host": "a"}})"},
       {"/links/2", R"({"name": "l3", "udp": {"host": "a/b", "port": 1}})"},
       {"/links/2", R"({"name": "l3", "udp": {"host": "a", "port": 1, "local_port": 0}})"},
       {"/links/2", R"({"name": "l3", "udp": {"host": "a", "port": 1, "mode": "x"}})"},
       {"/links/2", R"({"name": "l3", "udp": {"host": "a", "port": 1}, "line_baud": 9600})"},
       {"/devices/0/protocol", nullptr},
       {"/devices/0/protocol", R"("mc-3e")"},
       {"/devices/0/model", R"("FX5U")"},
       {"/devices/0/station", "1"},
       {"/devices/0/retries", "-1"},
       {"/devices/0/timeout_ms", R"("1s")"},
       {"/devices/0/echo", "0"},
       {"/devices/0/max_block_bytes", "255"},
       {"/devices/0/enquire", R"("sometimes")"},
       {"/devices/0/groups/0/name", nullptr},
       {"/devices/0/groups/0/publish", R"("changed")"},
       {"/devices/0/groups/0/interval_ms", "-1"},
       {"/devices/0/tags/0/name", R"("Temp")"},
       {"/devices/0/tags/0/address", nullptr},
       {"/devices/0/tags/0/address", "100"},
       {"/devices/0/tags/0/address", R"("X8")"},
       {"/devices/0/tags/0/address", R"("hr:0")"},
       {"/devices/0/tags/0/address", R"("M0.1")"},
       {"/devices/0/tags/0/type", R"("float")"},
       {"/devices/0/tags/0/type", R"("string")"},
       {"/devices/0/tags/0/length", "5"},
       {"/devices/0/tags/0/count", "0"},
       {"/devices/0/tags/0/word_order", R"("BADC")"},
       {"/devices/0/tags/0/scale", "0"},
       {"/devices/0/tags/0/scale", R"("0.1")"},
       {"/devices/0/tags/0/deadband", "-0.5"},
       {"/devices/0/tags/0/access", R"("write")"},
       {"/devices/0/tags/1/scale", "2"},
       {"/devices/0/tags/1/deadband", "2"},
       {"/devices/0/tags/1/word_order", R"("low_first")"},
       {"/devices/0/commands/allow/0", R"("T5")"},
       {"/devices/0/commands/allow/0", R"("K4M0")"},
       {"/devices/0/commands/allow/0", R"("M0-")"},
       {"/devices/0/commands/queue", "0"},
       {"/devices/0/commands/verify", R"("yes")"},
       {"/devices/0/commands/max_expiry_s", "0"}});
}

TEST(ConfigSchema, WhatOnlyTheLoaderCanFindFailsThere) {
  for (const Snippet& snippet : std::vector<Snippet>{
           {"/mqtt/username", R"("${FX_NO_SUCH}")"},
           {"/mqtt/password", R"("x")"},
           {"/mqtt/servers/0", R"("mqtt://a:0")"},
           {"/links/1/name", R"("line1")"},
           {"/links/2", R"({"name": "l3", "serial": {"path": "/dev/ttyUSB0"}})"},
           {"/devices/0/link", R"("line2")"},
           {"/devices/1/name", R"("press1")"},
           {"/devices/0/groups/1", R"({"name": "fast"})"},
           {"/devices/0/tags/0/group", R"("fats")"},
           {"/devices/0/tags/1/name", R"("temp")"},
           {"/devices/0/tags/0/address", R"("D9000")"},
           {"/devices/0/tags/0", R"({"name": "t", "address": "D7999", "count": 2})"},
           {"/devices/0/tags/0", R"({"name": "t", "address": "M0", "type": "int16"})"},
           {"/devices/0/tags/0", R"({"name": "t", "address": "M0", "deadband": 1})"},
           {"/devices/0/tags/0", R"({"name": "t", "address": "D0", "min": 2, "max": 1})"},
           {"/devices/0/tags/0", R"({"name": "t", "address": "D0.F", "access": "read_write"})"},
           {"/devices/0/tags/0", R"({"name": "t", "address": "M8037", "access": "read_write"})"},
           {"/devices/0/commands/allow/0", R"("M8034")"},
           {"/devices/0/commands/allow/0", R"("M9-M0")"},
           {"/devices/0/commands", R"({"default_expiry_s": 9, "max_expiry_s": 8})"}}) {
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
  expect_right(modbus_plant, {{"/devices/1/protocol", R"("modbus-rtu")"},
                              {"/devices/1/protocol", R"("modbus-ascii")"},
                              {"/devices/1/model", R"("auto")"},
                              {"/devices/1/unit", "255"},
                              {"/devices/1/max_read", "1"},
                              {"/devices/1/max_gap", "0"},
                              {"/devices/1/byte_order", R"("DCBA")"},
                              {"/devices/1/address_base", "1"},
                              {"/devices/1/allow_read_modify_write", "true"},
                              {"/devices/1/max_block_bytes", "100"},
                              {"/devices/1/echo", "true"},
                              {"/devices/1/tags/0/address", R"("IR:0x1f")"},
                              {"/devices/1/tags/0/address", R"("hr:7.15")"},
                              {"/devices/1/tags/0/address", R"("co:65535")"},
                              {"/devices/1/tags/0/address", R"("di:1")"},
                              {"/devices/1/tags/0/address", R"("40101")"},
                              {"/devices/1/tags/0/address", R"("300001.0")"},
                              {"/devices/1/tags/0/address", R"("00001")"},
                              {"/devices/1/tags/0/word_order", R"("BADC")"},
                              {"/devices/1/tags/0/states", R"({"0": "idle", "-17": "jam"})"},
                              {"/devices/1/tags/0/description", R"("")"},
                              {"/devices/1/tags/0/word_order", R"("low_first")"},
                              {"/devices/1/commands/allow",
                               R"(["hr:1-hr:2", "hr:1-0x20", "40001-40009", "co:3"])"}});
}

TEST(ConfigSchema, WhatIsWrongOnModbusFailsBoth) {
  expect_wrong(modbus_plant, {{"/devices/1/model", R"("FX3U")"},
                              {"/devices/1/unit", "256"},
                              {"/devices/1/unit", R"("1")"},
                              {"/devices/1/max_read", "126"},
                              {"/devices/1/max_gap", "-1"},
                              {"/devices/1/byte_order", R"("low_first")"},
                              {"/devices/1/address_base", "2"},
                              {"/devices/1/allow_read_modify_write", "1"},
                              {"/devices/1/enquire", R"("never")"},
                              {"/devices/1/station", "1"},
                              {"/devices/1/tags/0/address", R"("D100")"},
                              {"/devices/1/tags/0/address", R"("hr100")"},
                              {"/devices/1/tags/0/address", R"("hr:7.16")"},
                              {"/devices/1/tags/0/address", R"("co:7.1")"},
                              {"/devices/1/tags/0/address", R"("20001")"},
                              {"/devices/1/tags/0/address", R"("4001")"},
                              {"/devices/1/tags/0/word_order", R"("DACB")"},
                              {"/devices/1/tags/0/states", R"({"00": "idle"})"},
                              {"/devices/1/tags/0/states", R"({"0": ""})"},
                              {"/devices/1/tags/0/states", R"(["idle"])"},
                              {"/devices/1/tags/0/description", "1"},
                              {"/devices/1/tags/0/scale", "0"},
                              {"/devices/1/tags/0/length", "5"},
                              {"/devices/1/commands/allow/0", R"("M0")"},
                              {"/devices/1/commands/allow/0", R"("hr:1.3")"},
                              {"/devices/1/commands/allow/0", R"("hr:1-")"}});
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
  expect_right(mc_plant, {{"/devices/1/model", R"("FX3GE")"},
                          {"/devices/1/model", R"("auto")"},
                          {"/devices/1/code", R"("ascii")"},
                          {"/devices/1/pc", "0"},
                          {"/devices/1/monitoring_timer_ms", "250"},
                          {"/devices/1/monitoring_timer_ms", "60000"},
                          {"/devices/1/tags/0/address", R"("X1F")"},
                          {"/devices/1/tags/0/address", R"("b0ff")"},
                          {"/devices/1/tags/0/address", R"("W1A.F")"},
                          {"/devices/1/tags/0/address", R"("K8Y0")"},
                          {"/devices/1/tags/0/address", R"("F5")"},
                          {"/devices/1/tags/0/address", R"("TC5")"},
                          {"/devices/1/tags/0/address", R"("T5")"},
                          {"/devices/1/tags/0/word_order", R"("high_first")"},
                          {"/devices/1/commands/allow", R"(["W0..W1F", "TN5", "Y0-YF"])"}});
}

TEST(ConfigSchema, WhatIsWrongOf1EFramesFailsBoth) {
  expect_wrong(mc_plant, {{"/devices/1/model", R"("FX5U")"},
                          {"/devices/1/code", R"("text")"},
                          {"/devices/1/pc", "256"},
                          {"/devices/1/monitoring_timer_ms", "0"},
                          {"/devices/1/monitoring_timer_ms", "60001"},
                          {"/devices/1/station", "1"},
                          {"/devices/1/network", "1"},
                          {"/devices/1/tags/0/address", R"("hr:0")"},
                          {"/devices/1/tags/0/address", R"("XG")"},
                          {"/devices/1/tags/0/word_order", R"("BADC")"},

                          {"/devices/1/commands/allow/0", R"("K4M0")"}});
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
  if (snippet.value != nullptr)
    plant[json::json_pointer(snippet.pointer)] = json::parse(snippet.value);
  return plant;
}

TEST(ConfigSchema, WhatIsRightInTemplatesPassesBoth) {
  expect_right(
      many_plant,
      {{"", nullptr},
       {"/templates/unused", R"({"model": "FX3U"})"},
       {"/devices/0/n", R"("01-02,07")"},
       {"/devices/0/timeout_ms", "500"},
       {"/templates/meter/tags/0/type", R"("int32")"},
       {"/templates/meter/tags/0/description", R"("Meter {n}")"},
       {"/templates/meter/tags/0/states", R"({"0": "{n}"})"},
       {"/templates/meter/byte_order", R"("DCBA")"},
       {"/devices/2",
        R"({"name": "p{n}", "n": ["a", "b"], "link": "line1", "protocol": "fx-computer-link",
                "model": "FX3U", "tags": [{"name": "t", "address": "D0"}]})"}});
}

TEST(ConfigSchema, WhatIsWrongInTemplatesFailsBoth) {
  expect_wrong(many_plant, {{"/templates", "[]"},
                            {"/templates/A", "{}"},
                            {"/templates/meter/template", R"("meter")"},
                            {"/templates/meter/n", R"("1-2")"},
                            {"/templates/meter/colour", "1"},
                            {"/templates/meter/protocol", R"("mc")"},
                            {"/templates/meter/timeout_ms", R"("x")"},
                            {"/templates/meter/tags/0/colour", "1"},
                            {"/templates/meter/tags/0/type", R"("float")"},
                            {"/templates/meter/groups/0/publish", R"("x")"},
                            {"/templates/meter/commands/queue", "0"},
                            {"/devices/0/n", "5"},
                            {"/devices/0/n", R"("a-b")"},
                            {"/devices/0/n", "[]"},
                            {"/devices/0/n", "[1.5]"},
                            {"/devices/0/colour", "1"},
                            {"/devices/0/template", "5"},
                            {"/devices/0/unit", "256"}});
}

}  // namespace
}  // namespace fxagent
