// Telegraf's inputs.modbus.
#include <gtest/gtest.h>

#include <string>

#include "tests/agent/import/outcome.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;

TEST(Telegraf, StyleOfRegisters) {
  const Made made = made_of(R"(
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
    { name = "wide", byte_order = "ABCDEFGH", data_type = "INT64", scale=1.0, address = [5,6,7,8]},
  ]
  input_registers = [
    { name = "ph", byte_order = "ABCD", data_type = "FLOAT32-IEEE", scale=1.0, address = [1,2]},
  ]
[[inputs.cpu]]
)",
                            import_telegraf);
  ASSERT_FALSE(made.config.is_null()) << all_of(made.notes);
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
  EXPECT_EQ(notes_with(made, {"14: left out: torn: its addresses are not in a row"}), 1)
      << all_of(made.notes);
  EXPECT_EQ(notes_with(made, {"15: left out: wide", "INT64"}), 1);
  EXPECT_EQ(notes_with(made, {"left out: inputs.cpu"}), 1);
}

TEST(Telegraf, StyleOfRequests) {
  const Made made = made_of(R"(
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
)",
                            import_telegraf);
  ASSERT_EQ(made.config["devices"].size(), 2U) << all_of(made.notes);
  EXPECT_EQ(made.config["devices"][0]["protocol"], "modbus-rtu");
  EXPECT_EQ(made.config["devices"][1]["name"], "gw_2");
  EXPECT_EQ(made.config["links"][0]["serial"]["parity"], "even");
  EXPECT_EQ(made.config["devices"][0]["tags"], json::parse(R"([
    {"name":"voltage","address":"hr:0","type":"int16","word_order":"DCBA","scale":0.1,"group":"every_500_ms"},
    {"name":"energy","address":"hr:5","type":"float32","word_order":"DCBA","group":"every_500_ms"}])"));
  EXPECT_EQ(notes_with(made, {"not carried over: the measurement \"W\""}), 1);
  EXPECT_EQ(notes_with(made, {"not carried over: the tags of the request"}), 1);
}

TEST(Telegraf, StyleOfMetrics) {
  const Made made = made_of(R"(
[[inputs.modbus]]
  name = "m"
  controller = "tcp://192.0.2.1:502"
  configuration_type = "metric"
  [[inputs.modbus.metric]]
    slave_id = 1
    byte_order = "ABCD"
    fields = [
      { register="coil", address=0, name="door" },
      { register="input", address=3, name="rpm", type="UINT16" },
    ]
)",
                            import_telegraf);
  ASSERT_FALSE(made.config.is_null()) << all_of(made.notes);
  EXPECT_EQ(made.config["devices"][0]["tags"][0]["address"], "co:0");
  EXPECT_EQ(made.config["devices"][0]["tags"][1]["address"], "ir:3");
}

TEST(Telegraf, ModeAutoIsWhatTheControllerTakes) {
  const auto protocol_of = [](const std::string& controller) {
    const Made made = made_of(
        "[[inputs.modbus]]\n  name = \"m\"\n  transmission_mode = \"auto\"\n"
        "  controller = \"" +
            controller +
            "\"\n"
            "  holding_registers = [{name=\"a\", data_type=\"INT16\", address=[0]}]\n",
        import_telegraf);
    return made.config.is_null() ? json() : made.config["devices"][0]["protocol"];
  };
  EXPECT_EQ(protocol_of("file:///dev/ttyUSB0"), "modbus-rtu");
  EXPECT_EQ(protocol_of("tcp://192.0.2.1:502"), "modbus-tcp");
}

TEST(Telegraf, NoSettingIsDroppedInSilence) {
  const Made made = made_of(R"(
[[inputs.modbus]]
  name = "m"
  controller = "tcp://192.0.2.1:502"
  timeout = "2s"
  pause_between_requests = "30ms"
  busy_retries = 3
  holding_registers = [
    {name="a", data_type="INT16", address=[0], output="FLOAT64"}, {name="b", data_type="INT16", address=[1]}]
  [inputs.modbus.tags]
    plant = "north"
  [inputs.modbus.workarounds]
    one_request_per_field = true
)",
                            import_telegraf);
  ASSERT_FALSE(made.config.is_null()) << all_of(made.notes);
  EXPECT_EQ(made.config["devices"][0]["timeout_ms"], 2000);
  EXPECT_EQ(made.config["devices"][0]["gap_ms"], 30);
  EXPECT_EQ(notes_with(
                made, {"not carried over: busy_retries, tags, workarounds of inputs.modbus \"m\""}),
            1)
      << all_of(made.notes);
  EXPECT_EQ(notes_with(made, {"not carried over: output of a"}), 1);
  EXPECT_EQ(notes_with(made, {"not carried over"}), 2) << all_of(made.notes);
}

TEST(Telegraf, NumbersBeyondAllMeasureCostOneTagAtMost) {
  const Made made = made_of(R"(
[[inputs.modbus]]
  name = "m"
  interval = "1e300h"
  timeout = "nanh"
  controller = "tcp://192.0.2.1:0502"
  holding_registers = [
    {name="a", data_type="INT16", address=[0]},
    {name="b", data_type="INT16", address=[1], scale=inf},
    {name="c", data_type="INT16", address=[2], scale=nan}]
)",
                            import_telegraf);
  ASSERT_FALSE(made.config.is_null()) << all_of(made.notes);
  EXPECT_EQ(made.config["links"][0]["tcp"]["port"], 502);
  EXPECT_EQ(made.config["devices"][0]["tags"].size(), 1U);
  EXPECT_EQ(made.config["devices"][0]["groups"][0]["interval_ms"], 86'400'000);
  EXPECT_EQ(notes_with(made, {"left out: \"b\""}), 1) << all_of(made.notes);
  EXPECT_EQ(notes_with(made, {"left out: \"c\""}), 1) << all_of(made.notes);
}

TEST(Telegraf, NameBeyondAsciiIsSaidToLoseLetters) {
  const Made made = made_of(
      "[[inputs.modbus]]\nname = \"K\u00FChler\"\ncontroller = \"tcp://192.0.2.1:502\"\n"
      "holding_registers = [{name=\"\u6E29\u5EA6 a\", data_type=\"INT16\", address=[0]}]\n",
      import_telegraf);
  ASSERT_FALSE(made.config.is_null()) << all_of(made.notes);
  EXPECT_EQ(made.config["devices"][0]["name"], "k_hler");
  EXPECT_EQ(made.config["devices"][0]["tags"][0]["name"], "a");
  EXPECT_EQ(notes_with(made, {"is named k_hler"}), 1) << all_of(made.notes);
  EXPECT_EQ(notes_with(made, {"is named a:"}), 1) << all_of(made.notes);
}

TEST(Telegraf, TableWithoutANameIsAnErrorWithItsLine) {
  const auto broken = import_telegraf("[agent]\n[[;inputs.modbus]]\nname = \"a\"\n", {});
  ASSERT_FALSE(broken);
  EXPECT_EQ(broken.error().line, 2);
}

TEST(Telegraf, BrokenTextHasItsLine) {
  const auto broken = import_telegraf("[[inputs.modbus]]\nname = \n", {});
  ASSERT_FALSE(broken);
  EXPECT_EQ(broken.error().line, 2);
  EXPECT_FALSE(is_telegraf("inputs.modbus ="));
  EXPECT_FALSE(import_telegraf("[agent]\n", {}));
}

}  // namespace
}  // namespace fxagent
