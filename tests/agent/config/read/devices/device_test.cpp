#include "agent/config/config_error.h"
#include "agent/config/read/sections.h"

#include <gtest/gtest.h>

#include "protocol/plc.h"
#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;
using std::chrono::milliseconds;
using std::chrono::seconds;

const TagConfig& first_tag(const Config& config) { return config.devices.at(0).tags.at(0); }

/// Expects exactly one error, at `key` of a tag that has these members besides its name.
void expect_tag_error(const std::string& members, const std::string& key,
                      const std::vector<std::string>& words) {
  expect_error(with_tag(R"({"name": "t", )" + members + "}"), "/devices/0/tags/0/" + key, words);
}

std::string with_commands(const std::string& commands) {
  return changed("/devices/0/commands", commands);
}

// ---- devices ----------------------------------------------------------------------------------

TEST(ConfigDevice, DefaultsAreThoseOfTheContract) {
  const auto config = good(changed(
      "/devices/0", R"({"name": "d", "link": "line1", "protocol": "fx-programming-port"})"));
  const DeviceConfig& device = config.devices[0];
  EXPECT_EQ(device.timeout, milliseconds(1000));
  EXPECT_EQ(device.retries, 2);
  EXPECT_EQ(device.gap, milliseconds(0));
  EXPECT_EQ(device.turnaround, milliseconds(30));
  EXPECT_FALSE(device.echo);
  EXPECT_EQ(device.enquire, EnquirePolicy::open);
  EXPECT_TRUE(device.groups.empty());
  EXPECT_TRUE(device.tags.empty());
  EXPECT_TRUE(device.commands.allow.empty());
  EXPECT_FALSE(device.commands.allow_run_stop);
  EXPECT_EQ(device.commands.default_expiry, seconds(10));
  EXPECT_EQ(device.commands.max_expiry, seconds(3600));
  EXPECT_TRUE(device.commands.verify);
  EXPECT_EQ(device.commands.queue, 64U);
}

TEST(ConfigDevice, EverythingThatCanBeSetIsSet) {
  const auto config = good(changed("/devices/0", R"({
    "name": "d", "link": "gw1", "protocol": "fx-programming-port", "model": "FX3G",
    "timeout_ms": 1, "retries": 0, "gap_ms": 5, "turnaround_ms": 0, "echo": true,
    "max_block_bytes": 32, "enquire": "always", "command_set": "extended"})"));
  const DeviceConfig& device = config.devices[0];
  EXPECT_EQ(device.link, 1U);
  EXPECT_EQ(device.timeout, milliseconds(1));
  EXPECT_EQ(device.retries, 0);
  EXPECT_EQ(device.gap, milliseconds(5));
  EXPECT_EQ(device.turnaround, milliseconds(0));
  EXPECT_TRUE(device.echo);
  EXPECT_EQ(device.max_block_bytes, 32U);
  EXPECT_EQ(device.enquire, EnquirePolicy::always);
  EXPECT_EQ(model_of(*device.codec), "FX3G");
}

TEST(ConfigDevice, ValuesThatTakeSeveralReadsAreOneWarning) {
  const auto warnings = [](const char* tags) {
    return good(changed("/devices/0", R"({"name": "d", "link": "line1", "max_block_bytes": 4,
        "model": "FX3U", "protocol": "fx-programming-port", "tags": )" +
                                          std::string(tags) + "}"))
        .warnings;
  };
  EXPECT_EQ(warnings(R"([{"name": "whole", "address": "K8M8"}])").size(), 0U);
  // Five bytes: M0 to M39.
  const auto torn = warnings(R"([{"name": "whole", "address": "K8M8"},
      {"name": "a", "address": "K8M3"}, {"name": "b", "address": "D0", "type": "float64"},
      {"name": "c", "address": "D4", "type": "int64"}])");
  ASSERT_EQ(torn.size(), 1U) << torn.back();
  EXPECT_NE(torn[0].find("/tags/1/address"), std::string::npos) << torn[0];
  EXPECT_NE(torn[0].find("and 2 other tags of this device"), std::string::npos) << torn[0];
}

TEST(ConfigDevice, GapIsAMinuteAtMost) {
  EXPECT_EQ(good(changed("/devices/0/gap_ms", "60000")).devices[0].gap, milliseconds(60000));
  expect_refused("/devices/0/gap_ms", "60001", {"60000"});
  expect_refused("/devices/0/gap_ms", "90000", {"60000"});
}

TEST(ConfigDevice, OptionOutOfItsRangeIsRefused) {
  expect_refused("/devices/0/max_block_bytes", "1", {"2 to"});
  expect_refused("/devices/0/enquire", R"("sometimes")", {"open, always or never"});
  expect_refused("/devices/0/retries", "11", {"0 to 10"});
  expect_refused("/devices/0/timeout_ms", "0", {"1 to 600000"});
}

TEST(ConfigDevice, OptionsThatDoNotFitTheModelAreRefused) {
  auto plant = small_plant();
  plant["devices"][0]["model"] = "FX1S";
  plant["devices"][0]["command_set"] = "extended";
  expect_error(plant.dump(), "/devices/0/command_set", {"FX1S", "classic"});
}

TEST(ConfigDevice, OptionThatTheProtocolRefusesIsFoundBesideOthers) {
  auto plant = small_plant();
  plant["devices"] = nlohmann::json::parse(R"([
    {"name": "a", "link": "line1", "protocol": "fx-computer-link", "format": 2},
    {"name": "b", "link": "line1", "protocol": "fx-computer-link", "station": 1, "format": 4,
     "message_wait_ms": 15},
    {"name": "c", "link": "line1", "protocol": "fx-computer-link", "station": 16},
    {"name": "d", "link": "line1", "protocol": "fx-computer-link", "station": 2, "format": 3,
     "message_wait_ms": 15}])");
  const auto errors = errors_of(plant.dump());
  ASSERT_EQ(errors.size(), 4U) << listed(errors);
  EXPECT_EQ(errors[0].pointer, "/devices/0/format") << errors[0].text;
  EXPECT_EQ(errors[1].pointer, "/devices/1/message_wait_ms") << errors[1].text;
  EXPECT_EQ(errors[2].pointer, "/devices/2/station") << errors[2].text;
  EXPECT_NE(errors[2].text.find("0 to 15"), std::string::npos) << errors[2].text;
  EXPECT_EQ(errors[3].pointer, "/devices/3/format") << errors[3].text;
}

TEST(ConfigDevice, UnknownProtocolNamesTheNearest) {
  expect_refused("/devices/0/protocol", R"("fx-program-port")",
                 {"did you mean fx-programming-port?"});
}

TEST(ConfigDevice, UnknownProtocolDoesNotHideErrorsOfShape) {
  auto plant = small_plant();
  plant["devices"][0]["protocol"] = "x";
  plant["devices"][0]["tags"][0]["type"] = "int17";
  plant["devices"][0]["tags"][1]["min"] = 5;
  const auto errors = errors_of(plant.dump());
  EXPECT_EQ(errors.size(), 3U) << listed(errors);
}

TEST(ConfigDevice, UnknownModelNamesTheNearest) {
  expect_refused("/devices/0/model", R"("FX3A")", {"FX3G", "did you mean FX3S or FX3G"});
  expect_refused("/devices/0/model", R"("fx3u")", {"did you mean FX3U?"});
}

TEST(ConfigDevice, ModelCountsAsItsKin) {
  for (const auto& [name, kin] : {std::pair("FX1NC", "FX1N"),
                                  {"FX2NC", "FX2N"},
                                  {"FX3GC", "FX3G"},
                                  {"FX3GE", "FX3G"},
                                  {"FX3UC", "FX3U"}})
    for (const auto* protocol : {"fx-programming-port", "fx-computer-link"}) {
      auto plant = small_plant();
      plant["devices"][0]["protocol"] = protocol;
      plant["devices"][0]["model"] = name;
      EXPECT_EQ(model_of(*good(plant.dump()).devices[0].codec), kin);
    }
}

TEST(ConfigDevice, ModelOfAnotherSeriesIsSentToItsProtocol) {
  for (const auto* model : {R"("FX5U")", R"("FX5UC")", R"("fx5s")"})
    expect_refused("/devices/0/model", model,
                   {"fx-programming-port does not reach an FX5", "modbus-tcp or modbus-rtu"});
}

TEST(ConfigDevice, ModelOfAnotherProtocolIsSentToThatOne) {
  // The text includes the advice about the link.
  const auto text_for = [](const std::string& protocol, const std::string& model) {
    auto plant = small_plant();
    plant["devices"][0]["protocol"] = protocol;
    plant["devices"][0]["model"] = model;
    for (const ConfigError& error : errors_of(plant.dump()))
      if (error.pointer == "/devices/0/model") return error.text;
    return std::string();
  };
  struct Case {
    std::string protocol;
    std::string model;
    std::string cure;
  };
  for (const Case& c : {Case{"mc-3e", "FX3U", "mc-3e does not reach an FX3U; use mc-1e"},
                        Case{"mc-3e", "fx3uc", "does not reach an FX3UC; use mc-1e"},
                        Case{"mc-4e", "FX3GE", "use mc-1e"},
                        Case{"mc-1e", "FX2NC", "use fx-programming-port or fx-computer-link"},
                        Case{"mc-1e", "iQ-R", "use mc-3e or mc-4e"},
                        Case{"fx-programming-port", "Q",
                             "does not reach a Q; use mc-1e, mc-3e or mc-4e over "
                             "Ethernet, mc-3c or mc-4c on a serial line"},
                        Case{"fx-programming-port", "R04CPU", "does not reach an iQ-R; use mc-3e"},
                        Case{"fx-programming-port", "Q03UDE", "does not reach a Q; use mc-1e"}})
    EXPECT_NE(text_for(c.protocol, c.model).find(c.cure), std::string::npos)
        << c.model << ": " << text_for(c.protocol, c.model);
  for (const auto& [protocol, model, meant] :
       {std::tuple("mc-3e", "Q03UDE", "Q"), {"fx-programming-port", "FX3U-32MT", "FX3U"}})
    EXPECT_TRUE(text_for(protocol, model).ends_with("did you mean " + std::string(meant) + "?"));
}

TEST(ConfigDevice, RangeIsWrittenWithADashOrWithTwoDots) {
  const auto allow = [](const char* range) {
    return good(changed("/devices/0/commands/allow", "[\"" + std::string(range) + "\"]"))
        .devices[0]
        .commands.allow;
  };
  for (const char* same : {"M100..M199", "M100 - M199", "M100-199", "m100 .. 199"})
    EXPECT_EQ(allow(same), allow("M100-M199")) << same;
  EXPECT_EQ(allow("M100-M199").at(0).bits, 100U);
}

TEST(ConfigDevice, ModelAutoIsCheckedAgainstTheWidestAndNamesWhatSomeModelLacks) {
  for (const std::string& text :
       {without("/devices/0/model"), changed("/devices/0/model", R"("auto")")}) {
    const auto config = good(text);
    EXPECT_FALSE(warns(config, {"model auto"})) << "every model has D100, M0, M100-M199 and Y0-Y7";
    EXPECT_EQ(model_of(*config.devices[0].codec), "");
  }
  auto plant = small_plant();
  plant["devices"][0].erase("model");
  plant["devices"][0]["tags"][0]["address"] = "M7679";
  EXPECT_TRUE(warns(good(plant.dump()), {"/devices/0",
                                         "model auto: checked against FX3U, the widest; "
                                         "M7679 is not in every model (FX0N lacks it)"}));
  plant["devices"][0]["tags"][0]["address"] = "M7680";
  expect_error(plant.dump(), "/devices/0/tags/0/address", {"M7680", "M0-M7679"});
  plant["devices"][0]["tags"][0] = {{"name", "t"}, {"address", "D250"}, {"count", 10}};
  EXPECT_TRUE(warns(good(plant.dump()), {"D259 is not in every model (FX0N lacks it)"}))
      << "the end of an array counts";
  plant["devices"][0]["tags"] = nlohmann::json::array();
  plant["devices"][0]["commands"]["allow"] = {"D300-D399"};
  EXPECT_TRUE(warns(good(plant.dump()), {"D399 is not in every model"}))
      << "so does what is allowed";
}

TEST(ConfigDevice, NormalSetupsHaveNoWarning) {
  const char* const kDevices[] = {
      R"({"protocol": "modbus-tcp", "unit": 1, "tags": [
          {"name": "power", "address": "ir:12", "type": "float32"},
          {"name": "energy", "address": "hr:100", "type": "uint64"},
          {"name": "relay", "address": "co:3", "access": "read_write"}]})",
      R"({"protocol": "mc-3e", "tags": [
          {"name": "temp", "address": "D100", "scale": 0.1}, {"name": "count", "address": "D7000"},
          {"name": "run", "address": "M100", "access": "read_write"}, {"name": "in", "address": "X7"}],
          "commands": {"allow": ["M0-M99"]}})",
      R"({"protocol": "mc-3e", "model": "FX5U", "tags": [{"name": "in", "address": "X17"}]})"};
  for (const char* device : kDevices) {
    auto plant = small_plant();
    plant["links"] =
        nlohmann::json::parse(R"([{"name": "net", "tcp": {"host": "192.0.2.7", "port": 502}}])");
    plant["devices"] = nlohmann::json::array({nlohmann::json::parse(device)});
    plant["devices"][0]["name"] = "d";
    plant["devices"][0]["link"] = "net";
    const auto config = good(plant.dump());
    EXPECT_TRUE(config.warnings.empty()) << device << "\n" << config.warnings.front();
  }
}

TEST(ConfigDevice, TwoDevicesOfOneNameAreAnErrorThatNamesBoth) {
  expect_refused("/devices/1/name", R"("press1")", {"press1", "/devices/0/name (line "});
}

TEST(ConfigDevice, UnknownLinkNamesTheNearest) {
  expect_refused("/devices/0/link", R"("lime1")", {"lime1", "did you mean line1?"});
  expect_refused("/devices/0/link", R"("x")", {"there is no link \"x\"; there are gw1, line1"});
  auto plant = small_plant();
  for (int i = 1; i < 10; ++i) {
    plant["links"].push_back(plant["links"][1]);
    plant["links"].back()["name"] = "gw1" + std::to_string(i);
  }
  plant["devices"][0]["link"] = "x";
  expect_error(plant.dump(), "/devices/0/link",
               {"there are gw1, gw11, gw12, gw13, gw14, gw15, gw16, gw17 and 3 more"});
}

TEST(ConfigDevice, AWrongNameOfALinkIsReportedOnce) {
  auto plant = small_plant();
  plant["links"][0]["name"] = "Line1";
  expect_error(plant.dump(1), "/links/0/name", {"Line1"});
  plant["links"][0].erase("name");
  expect_error(plant.dump(1), "/links/0", {"\"name\" is missing"});
  plant["links"][0] = "line1";
  expect_error(plant.dump(1), "/links/0", {"must be an object"});
  plant.erase("links");
  expect_error(plant.dump(1), "", {"\"links\" is missing"});
}

TEST(ConfigDevice, AWrongNameOfALinkHidesNoOtherUnknownLink) {
  auto plant = small_plant();
  plant["links"][0]["name"] = "Line1";
  plant["devices"][1]["link"] = "gw2";
  const auto errors = errors_of(plant.dump(1));
  ASSERT_EQ(errors.size(), 2U) << listed(errors);
  EXPECT_EQ(errors[1].pointer, "/links/0/name");
  EXPECT_EQ(errors[0].text, "there is no link \"gw2\"; did you mean gw1?");
}

TEST(ConfigDevice, AWrongNameDoesNotShowItsVariable) {
  auto plant = small_plant();
  plant["links"][0]["name"] = "${SECRET}";
  plant["devices"][0]["link"] = "x";
  const auto errors = errors_of(plant.dump(1), environment({{"SECRET", "Hunter2"}}));
  ASSERT_FALSE(errors.empty());
  EXPECT_EQ(listed(errors).find("unter2"), std::string::npos) << listed(errors);
}

TEST(ConfigDevice, AWrongNameDoesNotTakeTheRightOne) {
  auto plant = small_plant();
  plant["links"].insert(plant["links"].begin(), plant["links"][0]);
  plant["links"][0]["name"] = "Line1";
  plant["links"][0]["serial"]["path"] = "/dev/ttyUSB1";
  expect_error(plant.dump(1), "/links/0/name", {"Line1"});
  plant["links"].erase(0);
  plant["devices"][0]["tags"] = {{{"name", "Temp"}, {"address", "D1"}},
                                 {{"name", "temp"}, {"address", "D2"}}};
  expect_error(plant.dump(1), "/devices/0/tags/0/name", {"Temp"});
}

/// Returns the pointers of the errors of a device with these members besides name, link and tags.
std::vector<std::string> faulty_places(const std::string& protocol, const std::string& members,
                                       const std::vector<std::string>& addresses,
                                       const std::vector<std::string>& allow = {}) {
  auto plant = small_plant();
  auto& device = plant["devices"][0];
  device = nlohmann::json::parse("{" + members + "}");
  device["name"] = "d";
  device["link"] = "gw1";
  device["protocol"] = protocol;
  plant["devices"].erase(1);
  for (std::size_t i = 0; i < addresses.size(); ++i)
    device["tags"].push_back({{"name", "t" + std::to_string(i)}, {"address", addresses[i]}});
  if (!allow.empty()) device["commands"]["allow"] = allow;
  std::vector<std::string> places;
  for (const ConfigError& error : errors_of(plant.dump(1)))
    places.push_back(error.pointer.substr(std::string_view("/devices/0/").size()));
  return places;
}

using Places = std::vector<std::string>;

TEST(ConfigDevice, AWrongModelHidesNoFaultOfTheTags) {
  EXPECT_EQ(faulty_places("fx-programming-port", R"("model": "FX9")",
                          {"X8", "D99999", "M0", "D7999"}, {"M0-M7", "M9999"}),
            (Places{"commands/allow/1", "model", "tags/0/address", "tags/1/address"}));
}

TEST(ConfigDevice, AWrongModelBringsNoFaultThatOnlySomeModelsHave) {
  // X1F is hexadecimal on Q, X10 octal on FX5U; both are errors while the model is unknown.
  EXPECT_EQ(faulty_places("mc-3e", R"("model": "FX9")", {"X10", "X1F", "D100", "X1G", "ZR100000"},
                          {"X10-X1F", "X10-X17", "X1-X1G"}),
            (Places{"commands/allow/2", "model", "tags/3/address"}));
  EXPECT_EQ(faulty_places("mc-1e", R"("model": "FX9")", {"X1F", "X17", "D8500", "B10", "X1G"}),
            (Places{"model", "tags/4/address"}));
}

TEST(ConfigDevice, AWrongModelBringsNoFaultOfThePartOfAValueThatOnlySomeModelsHave) {
  auto plant = small_plant();
  plant["devices"][1]["protocol"] = "mc-3e";
  plant["devices"][1]["model"] = "q06";
  plant["devices"][1]["tags"] = {{{"name", "in"}, {"address", "X10"}},
                                 {{"name", "two"}, {"address", "D7999"}, {"count", 2}}};
  expect_error(plant.dump(1), "/devices/1/model", {"did you mean Q?"});
}

TEST(ConfigDevice, AWrongModelGivesOneTextWhateverTheOtherTagsAre) {
  std::string first;
  for (const char* other : {"D100", "X1F"}) {
    auto plant = small_plant();
    plant["devices"][1]["protocol"] = "mc-3e";
    plant["devices"][1]["model"] = "FX9";
    plant["devices"][1]["tags"] = {{{"name", "other"}, {"address", other}},
                                   {{"name", "far"}, {"address", "D99999999"}}};
    const auto errors = errors_of(plant.dump(1));
    ASSERT_EQ(errors.size(), 2U) << listed(errors);
    EXPECT_EQ(errors[1].pointer, "/devices/1/tags/1/address");
    if (first.empty()) first = errors[1].text;
    EXPECT_EQ(errors[1].text, first) << other;
  }
}

TEST(ConfigDevice, AWrongOptionHidesNoFaultOfTheTags) {
  EXPECT_EQ(faulty_places("mc-3e", R"("model": "Q", "monitoring_timer_ms": 300)", {"X1F", "X1G"}),
            (Places{"monitoring_timer_ms", "tags/1/address"}));
}

TEST(ConfigDevice, SecondDeviceWithoutStationsOnALinkIsAWarning) {
  EXPECT_TRUE(warns(good(changed("/devices/1/link", R"("line1")")),
                    {"/devices/1/link", "same PLC", "/devices/0"}));
}

// ---- groups -----------------------------------------------------------------------------------

TEST(ConfigDevice, GroupsTakeWhatIsGiven) {
  const auto config = good(changed("/devices/0/groups", R"([
      {"name": "fast"}, {"name": "c", "interval_ms": 0, "publish": "on_change", "max_silent_s": 5}])"));
  const auto& groups = config.devices[0].groups;
  EXPECT_EQ(groups[0].interval, milliseconds(1000));
  EXPECT_FALSE(groups[0].on_change);
  EXPECT_EQ(groups[0].max_silent, seconds(60));
  EXPECT_EQ(groups[1].interval, milliseconds(0));
  EXPECT_TRUE(groups[1].on_change);
  EXPECT_EQ(groups[1].max_silent, seconds(5));
}

TEST(ConfigDevice, TagWithoutAGroupBringsTheDefaultOneAlong) {
  const auto config = good(small_plant().dump());
  const DeviceConfig& device = config.devices[0];
  ASSERT_EQ(device.groups.size(), 2U);
  EXPECT_EQ(device.groups[1].name, "default");
  EXPECT_EQ(device.groups[1].interval, milliseconds(1000));
  EXPECT_EQ(device.tags[0].group, 0U);
  EXPECT_EQ(device.tags[1].group, 1U);
}

TEST(ConfigDevice, DeclaredDefaultGroupIsUsed) {
  const auto config =
      good(changed("/devices/0/groups/1", R"({"name": "default", "interval_ms": 77})"));
  const DeviceConfig& device = config.devices[0];
  ASSERT_EQ(device.groups.size(), 2U);
  EXPECT_EQ(device.groups[device.tags[1].group].interval, milliseconds(77));
}

TEST(ConfigDevice, UnknownGroupNamesTheNearest) {
  expect_refused("/devices/0/tags/0/group", R"("fats")", {"fats", "did you mean fast?"});
  expect_refused("/devices/0/tags/0/group", R"("x")",
                 {"this device has no group \"x\"; there is fast"});
}

TEST(ConfigDevice, AWrongNameOfAGroupIsReportedOnce) {
  expect_refused("/devices/0/groups/0/name", R"("Fast")", {"Fast"});
  expect_error(without("/devices/0/groups/0/name"), "/devices/0/groups/0", {"\"name\" is missing"});
  expect_refused("/devices/0/groups/0", R"("fast")", {"must be an object"});
}

TEST(ConfigDevice, NamesGivenTwiceAreErrorsThatNameBoth) {
  expect_error(changed("/devices/0/groups/1", R"({"name": "fast"})"), "/devices/0/groups/1/name",
               {"fast", "/devices/0/groups/0/name (line "});
  expect_refused("/devices/0/tags/1/name", R"("temp")", {"temp", "/devices/0/tags/0/name (line "});
}

// ---- tags -------------------------------------------------------------------------------------

TEST(ConfigDevice, TagTakesWhatIsGiven) {
  const auto config = good(with_tag(R"({"name": "t", "address": "D100", "type": "int32", "count": 3,
      "word_order": "high_first", "scale": 0.5, "offset": -1, "unit": "°C", "min": 0, "max": 10.5,
      "deadband": 0.25, "group": "fast", "access": "read_write", "description": "Oil, before the filter",
      "states": {"10": "warm", "-1": "no sensor", "0": "cold"}})"));
  const TagConfig& tag = first_tag(config);
  EXPECT_EQ(tag.name, "t");
  EXPECT_EQ(tag.point.type, DataType::int32);
  EXPECT_EQ(tag.point.count, 3);
  EXPECT_TRUE(tag.point.is_array);
  EXPECT_EQ(tag.point.order, ByteOrder::abcd);
  EXPECT_EQ(tag.point.scale, 0.5);
  EXPECT_EQ(tag.point.offset, -1.0);
  EXPECT_EQ(tag.units->unit, "°C");
  EXPECT_EQ(tag.units->description, "Oil, before the filter");
  EXPECT_EQ(tag.units->states, (TagStates{{-1, "no sensor"}, {0, "cold"}, {10, "warm"}}));
  EXPECT_EQ(tag.units->limits.min, 0.0);
  EXPECT_EQ(tag.units->limits.max, 10.5);
  EXPECT_EQ(tag.units->limits.deadband, 0.25);
  EXPECT_TRUE(tag.writable);
}

TEST(ConfigDevice, StatesAreNamedByWholeNumbers) {
  const auto with = [](const std::string& type, const std::string& states) {
    return with_tag(R"({"name": "t", "address": "D100", "type": ")" + type + R"(", "states": )" +
                    states + "}");
  };
  const std::string place = "/devices/0/tags/0/states";
  expect_error(with("int16", R"({"run": "1"})"), place + "/run", {"whole number", "found \"run\""});
  expect_error(with("int16", R"({"01": "run"})"), place + "/01", {"whole number"});
  expect_error(with("int16", R"({"-0": "idle"})"), place + "/-0", {"whole number"});
  expect_error(with("int16", R"({"1.5": "idle"})"), place + "/1.5", {"whole number"});
  std::string twice = with("int16", R"({"1": "run"})");
  twice.replace(twice.find("\"run\""), 5, R"("run", "1": "stop")");
  expect_error(twice, place + "/1", {"duplicate"});
  expect_error(with("int16", R"({"1": ""})"), place + "/1", {"empty"});
  expect_error(with("int16", R"({"1": 1})"), place + "/1", {"string"});
  expect_error(with("int16", R"("idle")"), place, {"object"});
  expect_tag_error(R"("address": "D100", "description": "two\nlines")", "description",
                   {"control characters"});
  expect_error(with_tag(R"({"name": "t", "address": "M0", "states": {"2": "x"}})"), place + "/2",
               {"bool", "\"0\" and \"1\""});
  expect_error(with_tag(R"({"name": "t", "address": "D0", "type": "string", "length": 4,
                            "states": {"0": "x"}})"),
               place, {"not for string"});
  EXPECT_TRUE(first_tag(good(with("int16", "{}"))).units->states.empty());
}

TEST(ConfigDevice, DevicesOfTheSameTagsShareThem) {
  auto plant = small_plant();
  const auto tags = plant["devices"][0]["tags"];
  plant["devices"][1]["groups"] = plant["devices"][0]["groups"];
  const auto shared_with = [&](const nlohmann::json& other) {
    plant["devices"][1]["tags"] = other;
    const auto config = good(plant.dump());
    EXPECT_EQ(config.devices[1].tags.size(), other.size());
    return config.devices[0].tags.shares(config.devices[1].tags);
  };
  EXPECT_TRUE(shared_with(tags));
  const auto with = [&](const char* key, const nlohmann::json& value) {
    auto other = tags;
    other[0][key] = value;
    return other;
  };
  EXPECT_FALSE(shared_with(with("name", "temperature")));
  EXPECT_FALSE(shared_with(with("address", "D101")));
  EXPECT_FALSE(shared_with(with("type", "uint16")));
  EXPECT_FALSE(shared_with(with("scale", 0.1)));
  EXPECT_FALSE(shared_with(with("offset", 1)));
  EXPECT_FALSE(shared_with(with("max", 100)));
  EXPECT_FALSE(shared_with(with("description", "Oil")));
  EXPECT_FALSE(shared_with(with("states", {{"0", "cold"}})));
  EXPECT_FALSE(shared_with(with("access", "read_write")));
  auto more = tags;
  more.push_back({{"name", "level"}, {"address", "D102"}, {"group", "fast"}});
  EXPECT_FALSE(shared_with(more));
}

TEST(ConfigDevice, TagsAndDevicesShareWhatTheyHaveInCommon) {
  // A config may have 100,000 tags, so every additional byte counts 100,000 times.
  EXPECT_LE(sizeof(TagConfig), 96U);
  auto plant = small_plant();
  auto& devices = plant["devices"];
  devices[0]["tags"] = nlohmann::json::parse(R"([
    {"name": "a", "address": "D1", "unit": "bar", "max": 10},
    {"name": "b", "address": "D2", "unit": "bar", "max": 10},
    {"name": "c", "address": "D3", "unit": "bar", "max": 11},
    {"name": "d", "address": "D4", "unit": "", "description": "", "states": {}}])");
  devices[1] = devices[0];
  devices[1].update({{"name", "press2"}, {"link", "gw1"}});
  devices.push_back(devices[1]);
  devices[2].update({{"name", "press3"}, {"model", "FX2N"}});
  const auto config = good(plant.dump());
  const auto& tags = config.devices[0].tags;
  EXPECT_EQ(tags[0].units, tags[1].units);
  EXPECT_EQ(tags[0].units, config.devices[1].tags[0].units);
  EXPECT_EQ(tags[2].units->limits.max, 11.0);
  EXPECT_EQ(tags[3].units, no_units());
  EXPECT_EQ(config.devices[0].codec, config.devices[1].codec);
  EXPECT_EQ(config.devices[0].options, config.devices[1].options);
  EXPECT_EQ(std::get<std::string>(config.devices[2].options->at("model")), "FX2N");
  EXPECT_NE(config.devices[2].codec, config.devices[1].codec);
}

TEST(ConfigDevice, TypeDefaultsToWhatTheAddressIs) {
  struct Case {
    const char* address;
    DataType type;
  };
  for (const Case& c : {Case{"X17", DataType::boolean}, Case{"M8000", DataType::boolean},
                        Case{"D100.F", DataType::boolean}, Case{"TS5", DataType::boolean},
                        Case{"D8010", DataType::int16}, Case{"TN5", DataType::int16},
                        Case{"T5", DataType::int16}, Case{"CN200", DataType::int32},
                        Case{"K4M0", DataType::int16}, Case{"K8M0", DataType::int32}}) {
    const auto config =
        good(with_tag(R"({"name": "t", "address": ")" + std::string(c.address) + "\"}"));
    EXPECT_EQ(first_tag(config).point.type, c.type) << c.address;
    EXPECT_FALSE(first_tag(config).point.is_array);
    EXPECT_EQ(first_tag(config).point.order, ByteOrder::cdab);
  }
  EXPECT_EQ(first_tag(good(with_tag(R"({"name": "t", "address": "T5", "type": "bool"})")))
                .point.address.text,
            "TS5");
}

TEST(ConfigDevice, AddressThatIsNoneIsRefused) {
  for (const auto* address : {"X8", "Y19", "Q5", "D", "D-1", "M0.1", "K9M0", "D100.G", "40001",
                              "hr:0", "D 5", "D99999999999"})
    expect_tag_error(R"("address": ")" + std::string(address) + "\"", "address", {});
  expect_tag_error(R"("address": "X8")", "address", {"X8", "octal"});
}

TEST(ConfigDevice, AddressThatTheModelLacksIsRefusedWithTheRange) {
  struct Case {
    const char *model, *address, *range;
  };
  for (const Case& c : {Case{"FX1S", "D256", "D0-D255"}, Case{"FX1S", "Y16", "Y0-Y15"},
                        Case{"FX2N", "M3072", "M0-M3071"}, Case{"FX0N", "CN200", "CN235-CN254"},
                        Case{"FX3U", "D8512", "D8000-D8511"}}) {
    auto plant = small_plant();
    plant["devices"][0]["commands"].erase("allow");
    plant["devices"][0]["model"] = c.model;
    plant["devices"][0]["tags"][0]["address"] = c.address;
    expect_error(plant.dump(), "/devices/0/tags/0/address", {c.address, c.model, c.range});
  }
}

TEST(ConfigDevice, TypeThatDoesNotFitTheAddressIsRefused) {
  struct Case {
    const char *address, *type;
  };
  for (const Case& c :
       {Case{"M0", "int16"}, Case{"CN200", "int16"}, Case{"D0", "bool"}, Case{"D100.F", "int16"}}) {
    expect_tag_error(R"("address": ")" + std::string(c.address) + R"(", "type": ")" + c.type + "\"",
                     "type", {c.address});
  }
}

TEST(ConfigDevice, UnknownTypeNamesTheNearest) {
  expect_tag_error(R"("address": "D0", "type": "Int16")", "type", {"did you mean int16"});
  expect_tag_error(R"("address": "D0", "type": "sting", "length": 4)", "type",
                   {"did you mean string"});
}

TEST(ConfigDevice, WrongTypeDoesNotHideAWrongAddress) {
  const auto errors =
      errors_of(with_tag(R"({"name": "temp", "address": "D9000", "type": "int17"})"));
  ASSERT_EQ(errors.size(), 2U) << listed(errors);
  EXPECT_EQ(errors[0].pointer, "/devices/0/tags/0/address");
  EXPECT_EQ(errors[1].pointer, "/devices/0/tags/0/type");
  expect_error(with_tag(R"({"name": "temp", "address": "D100", "type": "int17"})"),
               "/devices/0/tags/0/type", {"int17"});
}

TEST(ConfigDevice, NumberOverTheEndOfItsRangeSaysSo) {
  expect_error(with_tag(R"({"name": "temp", "address": "D7999", "type": "int32"})"),
               "/devices/0/tags/0/address",
               {"D7999-D8000 does not exist as one range: FX3U has D0-D7999 and D8000-D8511"});
}

TEST(ConfigDevice, ArrayMustEndInsideTheModel) {
  good(with_tag(R"({"name": "t", "address": "D7990", "count": 10})"));
  expect_tag_error(R"("address": "D7990", "count": 11)", "address", {"D8000"});
  expect_tag_error(R"("address": "D7999", "type": "float32")", "address", {"D8000"});
  expect_tag_error(R"("address": "M7679", "count": 2)", "address", {"M7680"});
  good(with_tag(R"({"name": "t", "address": "CN250", "count": 6})"));
  expect_tag_error(R"("address": "CN250", "count": 7)", "address", {"CN256"});
}

TEST(ConfigDevice, AddressOutOfReachOfTheCommandSetIsRefused) {
  auto plant = small_plant();
  plant["devices"][0]["command_set"] = "classic";
  plant["devices"][0]["tags"][0]["address"] = "D1023";
  good(plant.dump());
  plant["devices"][0]["tags"][0]["address"] = "D1024";
  expect_error(plant.dump(), "/devices/0/tags/0/address", {"the protocol cannot reach", "D1024"});
}

TEST(ConfigDevice, LengthIsForStringsAndStringsNeedIt) {
  const auto config =
      good(with_tag(R"({"name": "t", "address": "D0", "type": "string", "length": 5})"));
  EXPECT_EQ(first_tag(config).point.length, 5);
  expect_error(with_tag(R"({"name": "t", "address": "D0", "type": "string"})"), "/devices/0/tags/0",
               {"length"});
  expect_tag_error(R"("address": "D0", "length": 5)", "length", {"count"});
  expect_tag_error(R"("address": "D0", "type": "string", "length": 0)", "length", {"1 to"});
}

TEST(ConfigDevice, WordOrderIsOneThatThisProtocolHas) {
  expect_tag_error(R"("address": "D0", "type": "int32", "word_order": "BADC")", "word_order",
                   {"low_first, high_first, ABCD or CDAB"});
  for (const auto& [word, order] : {std::pair("CDAB", ByteOrder::cdab), {"ABCD", ByteOrder::abcd}})
    EXPECT_EQ(first_tag(good(with_tag(
                            R"({"name": "t", "address": "D0", "type": "int32", "word_order": ")" +
                            std::string(word) + "\"}")))
                  .point.order,
              order);
  expect_tag_error(R"("address": "M0", "word_order": "low_first")", "word_order", {"bool"});
}

TEST(ConfigDevice, ScaleIsANumberOtherThanZero) {
  expect_tag_error(R"("address": "D0", "scale": 0)", "scale", {"0"});
  expect_tag_error(R"("address": "D0", "scale": "0.1")", "scale", {"a number"});
}

TEST(ConfigDevice, NumbersAreNotForBoolsAndStrings) {
  for (const std::string key : {"scale", "offset", "min", "max", "deadband"}) {
    const std::string two = "\"" + key + "\": 2";
    expect_tag_error(R"("address": "M0", )" + two, key, {"bool"});
    expect_tag_error(R"("address": "D0", "type": "string", "length": 2, )" + two, key, {"string"});
  }
}

TEST(ConfigDevice, LimitsAreInOrder) {
  expect_tag_error(R"("address": "D0", "min": 2, "max": 1)", "min", {"max"});
  expect_tag_error(R"("address": "D0", "deadband": -1)", "deadband", {"negative"});
  good(with_tag(R"({"name": "t", "address": "D0", "min": 1, "max": 1, "deadband": 0})"));
}

TEST(ConfigDevice, WhatCannotBeWrittenIsNotReadWrite) {
  struct Case {
    const char *address, *words;
  };
  for (const Case& c : {Case{"D100.F", "can only be read"}, Case{"K1M0", "whole bytes"},
                        Case{"K4M4", "whole bytes"}, Case{"M8034", "cannot be written by address"},
                        Case{"M8037", "cannot be written by address"},
                        Case{"M8118", "cannot be written by address"},
                        Case{"K2M8032", "cannot be written by address"}}) {
    const std::string tag = R"({"name": "t", "address": ")" + std::string(c.address) + "\"";
    good(with_tag(tag + "}"));
    expect_error(with_tag(tag + R"(, "access": "read_write"})"), "/devices/0/tags/0/access",
                 {c.words});
  }
}

TEST(ConfigDevice, WhatCanBeWrittenIsReadWrite) {
  for (const auto* address : {"D100", "M8033", "K4M0", "K2Y0", "Y17", "CN200", "TN5"})
    EXPECT_TRUE(first_tag(good(with_tag(R"({"name": "t", "address": ")" + std::string(address) +
                                        R"(", "access": "read_write"})")))
                    .writable)
        << address;
}

// ---- commands ---------------------------------------------------------------------------------

TEST(ConfigDevice, AllowListIsSortedAndMerged) {
  const auto config = good(
      with_commands(R"({"allow": ["D20-D29", "M100-M199", "D10-D19", "D15", "M300", "D31"]})"));
  const auto& codec = *config.devices[0].codec;
  const auto span = [&](const char* text) { return *codec.addresses().parse_range(text); };
  EXPECT_EQ(config.devices[0].commands.allow,
            (std::vector<Span>{span("M100-M199"), span("M300"), span("D10-D29"), span("D31")}));
}

TEST(ConfigDevice, AllowListOverATagWithLimitsIsWarnedOf) {
  nlohmann::json plant = small_plant();
  nlohmann::json& press = plant["devices"][0];
  press["tags"] = nlohmann::json::parse(R"([
    {"name": "plain", "address": "D205"},
    {"name": "setpoint", "address": "D200", "scale": 0.1, "max": 100, "access": "read_write"},
    {"name": "total", "address": "D209", "type": "int32", "min": 1, "access": "read_write"},
    {"name": "other", "address": "D220", "min": 1}])");
  press["commands"]["allow"] = {"M100-M199", "D200-D209"};
  EXPECT_TRUE(
      warns(good(plant.dump()), {"/devices/0/commands/allow",
                                 "D200 to D209 covers the tag setpoint at D200: ", "1 other tag"}));
  press["commands"]["allow"] = {"M100-M199", "D200"};
  EXPECT_TRUE(warns(good(plant.dump()), {"D200 covers the tag setpoint at D200: "}));
  press["commands"]["allow"] = {"D210-D219"};
  EXPECT_TRUE(warns(good(plant.dump()), {"D210 to D219 covers the tag total at D209: "}))
      << "a command may change half of its value";
  for (const char* range : {"D201-D208", "D211-D219", "D220-D299", "M200-M210"}) {
    press["commands"]["allow"] = {range};
    EXPECT_FALSE(warns(good(plant.dump()), {" covers "})) << range;
  }
}

TEST(ConfigDevice, AllowListOverDevicesThatAreNeverWrittenIsRefused) {
  for (const auto* range : {"M8034", "M8037", "M8118", "M8000-M8255", "M8030-M8034", "M8037-M8040"})
    expect_error(with_commands(R"({"allow": ["D0", ")" + std::string(range) + "\"]}"),
                 "/devices/0/commands/allow/1", {"cannot be written by address"});
  good(with_commands(R"({"allow": ["M8000-M8033", "M8038-M8117", "M8119"]})"));
}

TEST(ConfigDevice, AllowEntryThatIsNoRangeIsRefused) {
  for (const auto* range : {"T5", "C0-C9", "M0-D5", "M9-M0", "M0-", "-", "Y8", "M9999", "K4M0",
                            "M7000-M8000", "D0-D9-D20"})
    expect_error(with_commands(R"({"allow": [")" + std::string(range) + "\"]}"),
                 "/devices/0/commands/allow/0", {});
  expect_error(with_commands(R"({"allow": ["M100,M101"]})"), "/devices/0/commands/allow/0",
               {"each range is an entry of its own"});
}

TEST(ConfigDevice, ExpiryDefaultFitsItsMaximum) {
  expect_error(with_commands(R"({"default_expiry_s": 61, "max_expiry_s": 60})"),
               "/devices/0/commands/default_expiry_s", {"60"});
  EXPECT_EQ(good(with_commands(R"({"max_expiry_s": 5})")).devices[0].commands.default_expiry,
            seconds(5));
}

TEST(ConfigDevice, QueueHasRoomForOneAtLeast) {
  expect_error(with_commands(R"({"queue": 0})"), "/devices/0/commands/queue", {"1 to 10000"});
  expect_error(with_commands(R"({"queue": 10001})"), "/devices/0/commands/queue", {"1 to 10000"});
  EXPECT_EQ(good(with_commands(R"({"queue": 10000})")).devices[0].commands.queue, 10000U);
}

TEST(ConfigDevice, RunAndStopAreAllowedWhereTheProtocolHasThem) {
  const auto config = good(with_commands(R"({"allow_run_stop": true, "verify": false})"));
  EXPECT_TRUE(config.devices[0].commands.allow_run_stop);
  EXPECT_FALSE(config.devices[0].commands.verify);
  EXPECT_TRUE(config.warnings.empty());
}

}  // namespace
}  // namespace fxagent
