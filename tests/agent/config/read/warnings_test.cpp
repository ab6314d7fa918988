#include <gtest/gtest.h>

#include <algorithm>

#include "tests/agent/config/small_plant.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using namespace test;

/// Returns the warnings of a config that the small plant does not have.
std::vector<std::string> warnings_of(const std::string& text) {
  const auto config = good(text);
  const auto usual = good(small_plant().dump(1)).warnings;
  std::vector<std::string> list;
  for (const std::string& warning : config.warnings)
    if (std::find(usual.begin(), usual.end(), warning) == usual.end()) list.push_back(warning);
  return list;
}

/// Returns the warning for a tag at D100 with these additional keys, without its place.
std::string of_tag(const std::string& keys) {
  const auto list = warnings_of(with_tag(R"({"name": "temp", "address": "D100", )" + keys + "}"));
  EXPECT_LE(list.size(), 1U) << keys;
  if (list.empty()) return "";
  EXPECT_TRUE(list[0].starts_with("/devices/0/tags/0/")) << list[0];
  return list[0].substr(list[0].find("): ") + 3);
}

std::string of_group(const std::string& group) {
  const auto list = warnings_of(changed("/devices/0/groups/0", group));
  EXPECT_LE(list.size(), 1U) << group;
  return list.empty() ? "" : list[0];
}

// ---- limits -----------------------------------------------------------------------------------

TEST(ConfigWarnings, LimitsInsideWhatTheTypeHoldsAreFine) {
  for (const char* keys :
       {R"("min": -32768, "max": 32767)", R"("type": "uint16", "min": 0, "max": 65535)",
        R"("scale": 0.1, "min": -3276.8, "max": 3276.7)", R"("min": 5)", R"("max": 6)",
        R"("scale": -0.1, "offset": 7, "min": -3269.7, "max": 3283.8)",
        R"("type": "bcd16", "min": 0, "max": 9999)", R"("min": 4, "max": 5)",
        R"("type": "float32", "min": -1e30, "max": 1e30)",
        R"("type": "int32", "min": -2147483648, "max": 2147483647)"})
    EXPECT_EQ(of_tag(keys), "") << keys;
}

TEST(ConfigWarnings, LimitBeyondWhatTheTypeHoldsHasNoEffect) {
  EXPECT_EQ(of_tag(R"("min": -40000)"),
            "has no effect: the values of this tag go from -32768 to 32767");
  EXPECT_EQ(of_tag(R"("max": 40000)"),
            "has no effect: the values of this tag go from -32768 to 32767");
  EXPECT_EQ(of_tag(R"("type": "uint16", "scale": 0.1, "min": -1)"),
            "has no effect: the values of this tag go from 0 to 6553.5");
  EXPECT_EQ(of_tag(R"("scale": -1, "max": 32769)"),
            "has no effect: the values of this tag go from -32767 to 32768");
  EXPECT_EQ(of_tag(R"("type": "bcd16", "max": 10000)"),
            "has no effect: the values of this tag go from 0 to 9999");
  expect_says(of_tag(R"("type": "float32", "max": 1e39)"), "has no effect");
  const auto both = warnings_of(
      with_tag(R"({"name": "temp", "address": "K2M0", "type": "int16", "min": -1, "max": 256})"));
  ASSERT_EQ(both.size(), 2U);
  EXPECT_TRUE(both[0].starts_with("/devices/0/tags/0/max (line ")) << both[0];
  EXPECT_TRUE(both[1].starts_with("/devices/0/tags/0/min (line ")) << both[1];
}

TEST(ConfigWarnings, LimitsThatLeaveOneValueOrNoneSaySo) {
  EXPECT_EQ(of_tag(R"("scale": 10, "min": 1, "max": 9)"),
            "no value of this tag is within its limits: its values go from -327680 to 327670 in "
            "steps of 10");
  EXPECT_EQ(of_tag(R"("scale": 10, "min": 1, "max": 11)"),
            "only one value of this tag is within its limits: its values go from -327680 to 327670 "
            "in steps of 10");
  EXPECT_EQ(of_tag(R"("min": 40000)"),
            "no value of this tag is within its limits: its values go from -32768 to 32767 in "
            "steps of 1");
  EXPECT_EQ(of_tag(R"("max": -40000)"),
            "no value of this tag is within its limits: its values go from -32768 to 32767 in "
            "steps of 1");
  EXPECT_EQ(of_tag(R"("type": "float32", "min": 0.1, "max": 0.2)"), "");
}

TEST(ConfigWarnings, DeadbandLargerThanTheRangeIsNeverReached) {
  const auto of_deadband = [](const std::string& keys) {
    auto plant = nlohmann::json::parse(
        with_tag(R"({"name": "temp", "address": "D100", "group": "fast", )" + keys + "}"));
    plant["devices"][0]["groups"][0]["publish"] = "on_change";
    const auto list = warnings_of(plant.dump(1));
    EXPECT_LE(list.size(), 1U) << keys;
    return list.empty() ? "" : list[0].substr(list[0].find("): ") + 3);
  };
  EXPECT_EQ(of_deadband(R"("deadband": 65535)"), "");
  EXPECT_EQ(of_deadband(R"("deadband": 65536)"),
            "no change is this large: the values of this tag go from -32768 to 32767");
  EXPECT_EQ(of_deadband(R"("scale": -0.1, "deadband": 6554)"),
            "no change is this large: the values of this tag go from -3276.7 to 3276.8");
  EXPECT_EQ(of_deadband(R"("type": "float32", "deadband": 1e9)"), "");
}

TEST(ConfigWarnings, DeadbandInAGroupThatPublishesEveryPollHoldsNothingBack) {
  EXPECT_EQ(of_tag(R"("deadband": 5)"),
            "does not hold back a sample: the group publishes every poll. Set its \"publish\" to "
            "\"on_change\"");
  auto plant = small_plant();
  plant["devices"][0]["tags"] = nlohmann::json::parse(R"([
    {"name": "a", "address": "D1", "deadband": 1}, {"name": "b", "address": "D2"},
    {"name": "c", "address": "D3", "deadband": 1, "group": "fast"},
    {"name": "d", "address": "D4", "deadband": 1}])");
  plant["devices"][0]["groups"][0]["publish"] = "on_change";
  const auto list = warnings_of(plant.dump(1));
  ASSERT_EQ(list.size(), 1U);
  EXPECT_TRUE(list[0].starts_with("/devices/0/tags/0/deadband (line ")) << list[0];
  expect_says(list[0], "does not hold back a sample, and 1 other tag of this device, too");
}

TEST(ConfigWarnings, TimeoutShorterThanTheTurnaroundIsTooShortForAnyAnswer) {
  const auto of_device = [](const nlohmann::json& keys) {
    auto plant = small_plant();
    plant["devices"][0].update(keys);
    const auto list = warnings_of(plant.dump(1));
    return list.empty() ? "" : list[0];
  };
  EXPECT_EQ(of_device({{"timeout_ms", 40}, {"turnaround_ms", 40}}), "");
  const auto found = of_device({{"timeout_ms", 39}, {"turnaround_ms", 40}});
  EXPECT_TRUE(found.starts_with("/devices/0/timeout_ms (line ")) << found;
  expect_says(found, "shorter than turnaround_ms, the 40 ms that the device may need");
  EXPECT_EQ(of_device({{"turnaround_ms", 5000}}), "") << "timeout_ms is not given";
  EXPECT_EQ(of_device({{"timeout_ms", 20}}), "") << "the 30 ms are only a default";
}

TEST(ConfigWarnings, LimitsOfATagWithErrorsAreLeftAlone) {
  expect_error(with_tag(R"({"name": "temp", "address": "M0", "type": "int16", "min": -40000})"),
               "/devices/0/tags/0/type", {"M0"});
}

// ---- groups -----------------------------------------------------------------------------------

TEST(ConfigWarnings, SilenceShorterThanTheIntervalHasNoEffect) {
  EXPECT_EQ(of_group(R"({"name": "fast", "interval_ms": 5000, "max_silent_s": 5})"), "");
  const auto given = of_group(R"({"name": "fast", "interval_ms": 5001, "max_silent_s": 5})");
  EXPECT_TRUE(given.starts_with("/devices/0/groups/0/max_silent_s (line ")) << given;
  expect_says(given, "is shorter than interval_ms: every poll is published");
  const auto fallback =
      of_group(R"({"name": "fast", "interval_ms": 61000, "publish": "on_change"})");
  EXPECT_TRUE(fallback.starts_with("/devices/0/groups/0/publish (line ")) << fallback;
  expect_says(fallback, "max_silent_s (by default 60");
  EXPECT_EQ(of_group(R"({"name": "fast", "interval_ms": 61000})"), "");
}

// ---- stations ---------------------------------------------------------------------------------

TEST(ConfigWarnings, TwoDevicesOfOneStationOnALinkAreOnePlc) {
  auto plant = small_plant();
  plant["devices"] = nlohmann::json::parse(R"([
    {"name": "a", "link": "line1", "protocol": "fx-computer-link", "model": "FX3U", "station": 3},
    {"name": "b", "link": "line1", "protocol": "fx-computer-link", "model": "FX3U", "station": 4},
    {"name": "c", "link": "line1", "protocol": "fx-computer-link", "model": "FX3U", "station": 3},
    {"name": "d", "link": "gw1", "protocol": "modbus-tcp"},
    {"name": "e", "link": "gw1", "protocol": "modbus-tcp"}])");
  const auto list = warnings_of(plant.dump(1));
  ASSERT_EQ(list.size(), 2U);
  EXPECT_TRUE(list[0].starts_with("/devices/2/station (line ")) << list[0];
  expect_says(list[0], "station 3 is that of /devices/0 (line ");
  EXPECT_TRUE(list[1].starts_with("/devices/4 (line ")) << list[1];
  expect_says(list[1], "is that of /devices/3 (line ");
}

// ---- lines ------------------------------------------------------------------------------------

/// Returns the warnings for the first device's serial line with these settings and this protocol.
std::vector<std::string> of_line(const std::string& serial, const std::string& protocol,
                                 const std::string& model) {
  return warnings_of(
      R"({"agent":{"id":"edge7","root":"fx"},"mqtt":{"servers":["mqtt://127.0.0.1:1"]},)"
      R"("store":{"path":"/tmp"},"links":[{"name":"line1","serial":{"path":"/dev/x",)" +
      serial + R"(}}],"devices":[{"name":"press1","link":"line1","protocol":")" + protocol + "\"" +
      model + R"(,"tags":[{"name":"t","address":")" +
      (protocol.starts_with("fx-") ? "D1" : "hr:1") + R"("}]}]})");
}

TEST(ConfigWarnings, SpeedsThatADocumentKnowsAreFine) {
  for (const char* baud : {"9600", "19200"})
    for (const char* model : {"FX1S", "FX2N", "FX3U"})
      for (const char* protocol : {"fx-programming-port", "fx-computer-link"})
        EXPECT_TRUE(of_line(R"("baud":)" + std::string(baud), protocol,
                            R"(,"model":")" + std::string(model) + "\"")
                        .empty())
            << baud << model << protocol;
  EXPECT_TRUE(of_line(R"("baud":115200)", "fx-programming-port", R"(,"model":"FX3UC")").empty());
  EXPECT_TRUE(of_line(R"("baud":38400)", "fx-computer-link", R"(,"model":"FX3G")").empty());
  EXPECT_TRUE(of_line(R"("baud":300)", "fx-computer-link", R"(,"model":"FX2N")").empty());
  EXPECT_TRUE(of_line(R"("baud":14400)", "modbus-rtu", "").empty());
}

TEST(ConfigWarnings, SpeedThatNoDocumentOfTheProtocolKnowsIsToldWithThoseItDoes) {
  auto found = of_line(R"("baud":4800)", "fx-programming-port", R"(,"model":"FX2N")");
  ASSERT_EQ(found.size(), 1U);
  expect_says(found[0], "/links/0/serial/baud");
  expect_says(found[0],
              "4800 baud is not a known speed of fx-programming-port; its speeds are "
              "9600, 19200, 38400, 57600, 115200");
  found = of_line(R"("baud":115200)", "fx-computer-link", R"(,"model":"FX3U")");
  ASSERT_EQ(found.size(), 1U);
  expect_says(found[0], "19200, 38400");
}

TEST(ConfigWarnings, SpeedThatTheModelDoesNotReachIsTold) {
  for (const char* protocol : {"fx-programming-port", "fx-computer-link"}) {
    const auto found = of_line(R"("baud":38400)", protocol, R"(,"model":"FX2N")");
    ASSERT_EQ(found.size(), 1U) << protocol;
    expect_says(found[0], "press1 is an FX2N, whose highest speed is 19200 baud");
  }
}

TEST(ConfigWarnings, AnFx3OverUdpWithoutALocalPortIsTold) {
  const auto found = [](const char* protocol, const char* model, const char* udp) {
    auto plant = small_plant();
    plant["links"] = nlohmann::json::array({{{"name", "eth1"}}});
    plant["links"][0]["udp"] = nlohmann::json::parse(udp);
    plant["devices"] = nlohmann::json::array();
    for (const char* name : {"press1", "press2"})
      plant["devices"].push_back({{"name", name},
                                  {"link", "eth1"},
                                  {"protocol", protocol},
                                  {"model", model},
                                  {"pc", name[5] - '0'}});
    return warnings_of(plant.dump());
  };
  const char* any = R"({"host": "192.0.2.20", "port": 5001})";
  for (const char* model : {"auto", "FX3U"}) {
    const auto warnings = found("mc-1e", model, any);
    ASSERT_EQ(warnings.size(), 1U) << model;
    expect_says(warnings[0], "/links/0/udp");
    expect_says(warnings[0], "set local_port");
  }
  EXPECT_TRUE(found("mc-1e", "Q", any).empty());
  EXPECT_TRUE(found("mc-3e", "FX5U", any).empty());
  EXPECT_TRUE(found("mc-1e", "FX3U", R"({"host": "192.0.2.20", "port": 5001, "local_port": 5001})")
                  .empty());
}

TEST(ConfigWarnings, ProgrammingPortThatIsNot7E1IsTold) {
  for (const char* serial :
       {R"("data_bits":8,"parity":"none")", R"("parity":"odd")", R"("stop_bits":2)"}) {
    const auto found = of_line(serial, "fx-programming-port", R"(,"model":"FX2N")");
    ASSERT_EQ(found.size(), 1U) << serial;
    expect_says(found[0], "7 data bits, even parity and 1 stop bit");
    EXPECT_TRUE(of_line(serial, "fx-computer-link", R"(,"model":"FX2N")").empty());
  }
}

}  // namespace
}  // namespace fxagent
