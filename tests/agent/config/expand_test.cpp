// A config with every device written out in full.
#include "agent/config/expand.h"
#include "agent/config/source.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <nlohmann/json.hpp>

#include "tests/agent/config/small_plant.h"
#include "tests/support/says.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;

const char* const kMeters = R"({
  "agent": {"id": "edge7"},
  "mqtt": {"servers": ["mqtt://127.0.0.1:1883"], "password": "${PASSWORD}"},
  "store": {"path": "/var/lib/fxagent"},
  "brokers": [{"name": "cloud", "servers": ["mqtts://a", "mqtts://b"]}],
  "profiles": [{"kind": "json"}, {"kind": "json", "broker": "cloud"}],
  "links": [{"name": "l1", "serial": {"path": "/dev/ttyUSB0"}}],
  "templates": {"meter": {
    "protocol": "modbus-rtu",
    "groups": [{"name": "g{n}", "interval_ms": "{n}"}],
    "tags": [{"name": "power", "address": "ir:{n}", "scale": 0.10, "group": "g{n}",
              "description": "Of meter {n}", "states": {"0": "{n} off"}},
             {"name": "{n}", "address": "ir:1", "min": "{n}", "unit": "${UNIT}"}],
    "commands": {"allow": ["hr:{n}"], "queue": "{n}"}}},
  "devices": [
    {"template": "meter", "name": "m{n}", "n": "01-02", "link": "l1", "unit": "{n}"},
    {"name": "plain", "link": "l1", "protocol": "modbus-rtu", "unit": 9,
     "tags": [{"name": "t", "address": "hr:0", "unit": "{n}"}]}]
})";

const Environment& variables() {
  static const auto from = environment({{"PASSWORD", "hunter2"}, {"UNIT", "W"}});
  return from;
}

TEST(ExpandedConfig, WritesEveryDeviceOut) {
  const json out = json::parse(expanded_config(kMeters, variables()));
  EXPECT_FALSE(out.contains("templates"));
  ASSERT_EQ(out["devices"].size(), 3U);
  EXPECT_EQ(out["devices"][1], json::parse(R"({
    "name": "m02", "link": "l1", "unit": 2, "protocol": "modbus-rtu",
    "groups": [{"name": "g02", "interval_ms": 2}],
    "tags": [{"name": "power", "address": "ir:02", "scale": 0.1, "group": "g02",
              "description": "Of meter 02", "states": {"0": "02 off"}},
             {"name": "02", "address": "ir:1", "min": 2, "unit": "${UNIT}"}],
    "commands": {"allow": ["hr:02"], "queue": 2}})"));
  EXPECT_EQ(out["devices"][2]["tags"][0]["unit"], "{n}");
}

TEST(ExpandedConfig, IsARightConfigThatMeansTheSame) {
  const std::string once = expanded_config(kMeters, variables());
  const Config before = good(kMeters, variables());
  const Config after = good(once, variables());
  ASSERT_EQ(after.brokers.size(), 1U);
  EXPECT_EQ(before.brokers[0].mqtt.servers, after.brokers[0].mqtt.servers);
  ASSERT_EQ(before.devices.size(), after.devices.size());
  for (std::size_t i = 0; i < before.devices.size(); ++i) {
    EXPECT_EQ(before.devices[i].name, after.devices[i].name);
    EXPECT_EQ(*before.devices[i].options, *after.devices[i].options);
    ASSERT_EQ(before.devices[i].tags.size(), after.devices[i].tags.size());
    for (std::size_t t = 0; t < before.devices[i].tags.size(); ++t)
      EXPECT_EQ(before.devices[i].tags[t].point.address.text,
                after.devices[i].tags[t].point.address.text);
  }
  EXPECT_EQ(expanded_config(once, variables()), once);
}

TEST(ExpandedConfig, LeavesSecretsAndNumbersAsTheyStand) {
  const std::string text = expanded_config(kMeters, variables());
  EXPECT_EQ(text.find("hunter2"), std::string::npos);
  expect_says(text, "\"${PASSWORD}\"");
  expect_says(text, "\"scale\": 0.10");
}

TEST(ExpandedConfig, IsWrittenAsPeopleDo) {
  const std::string text = expanded_config(kMeters, variables());
  EXPECT_TRUE(text.starts_with("{\n  \"agent\": {\"id\": \"edge7\"},\n  \"mqtt\": {")) << text;
  expect_says(text, "\n      \"groups\": [{\"name\": \"g01\", \"interval_ms\": 1}],\n");
  EXPECT_TRUE(text.ends_with("\n  ]\n}\n"));
}

TEST(ExpandedConfig, DropsComments) {
  std::string text = kMeters;
  text.insert(text.find("\"tags\""), "/* of the meter */");
  text.insert(text.find("\"devices\""), "// all of them\n");
  EXPECT_EQ(expanded_config(text, variables()), expanded_config(kMeters, variables()));
}

TEST(ExpandedConfig, WithoutTemplatesItIsTheFile) {
  for (const char* name : {"agent.example.json", "demo/agent.json"}) {
    const std::string text = content_of(std::string(FXAGENT_CONFIG_DIR "/") + name);
    EXPECT_EQ(json::parse(expanded_config(text, environment())), json::parse(text));
  }
}

TEST(ExpandedConfig, PipeIsReadOnce) {
  std::array<int, 2> ends{};
  ASSERT_EQ(::pipe(ends.data()), 0);
  const std::string plant = small_plant().dump();  // fits into a pipe's buffer
  ASSERT_EQ(::write(ends[1], plant.data(), plant.size()), std::ssize(plant));
  ::close(ends[1]);
  const auto expanded = expanded_config("/dev/fd/" + std::to_string(ends[0]));
  ::close(ends[0]);
  ASSERT_TRUE(expanded) << listed(expanded.error());
  EXPECT_EQ(json::parse(*expanded), small_plant());
}

TEST(ExpandedConfig, AWrongFileHasItsErrors) {
  expect_says(listed(error_of(expanded_config("/nowhere/agent.json"))), "cannot be read");
}

}  // namespace
}  // namespace fxagent
