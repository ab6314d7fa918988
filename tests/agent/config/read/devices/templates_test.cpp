// Device templates and their entries: the resulting devices, and every error text.
#include "agent/config/read/devices/templates.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "agent/config/config_difference.h"
#include "agent/config/keys.h"
#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;

/// A line with forty meters.
json meters() {
  return json::parse(R"({
    "agent": {"id": "edge7"},
    "mqtt": {"servers": ["mqtt://127.0.0.1:1883"]},
    "store": {"path": "/var/lib/fxagent"},
    "links": [{"name": "line1", "serial": {"path": "/dev/ttyUSB0"}}],
    "templates": {"meter": {
      "protocol": "modbus-rtu", "timeout_ms": 300,
      "groups": [{"name": "slow", "interval_ms": 5000}],
      "tags": [{"name": "power", "address": "ir:12", "group": "slow"},
               {"name": "energy", "address": "ir:342", "type": "int32", "group": "slow"}],
      "commands": {"allow": ["hr:{n}", "hr:100"]}}},
    "devices": [{"template": "meter", "name": "meter{n}", "n": "1-40", "link": "line1",
                 "unit": "{n}"}]
  })");
}

std::string with(const std::string& pointer, const std::string& value) {
  json plant = meters();
  plant[json::json_pointer(pointer)] = json::parse(value);
  return plant.dump(1);
}

std::int64_t unit_of(const DeviceConfig& device) {
  return std::get<std::int64_t>(device.options->at("unit"));
}

std::vector<std::string> names(const Config& config) {
  std::vector<std::string> list;
  for (const DeviceConfig& device : config.devices) list.push_back(device.name);
  return list;
}

std::vector<std::string> tags(const DeviceConfig& device) {
  std::vector<std::string> list;
  for (const TagConfig& tag : device.tags)
    list.push_back(std::string(std::string_view(tag.name)) + "=" + tag.point.address.text);
  return list;
}

using Strings = std::vector<std::string>;

// ---- results -----------------------------------------------------------------------------------

TEST(Templates, OneEntryMakesADeviceForEachNumber) {
  const Config config = good(meters().dump());
  ASSERT_EQ(config.devices.size(), 40U);
  EXPECT_EQ(config.devices[0].name, "meter1");
  EXPECT_EQ(config.devices[39].name, "meter40");
  EXPECT_EQ(unit_of(config.devices[39]), 40);
  EXPECT_EQ(config.devices[39].timeout.count(), 300);
  EXPECT_EQ(tags(config.devices[39]), (Strings{"power=ir:12", "energy=ir:342"}));
  EXPECT_EQ(config.devices[39].groups.at(0).interval.count(), 5000);
  EXPECT_EQ(config.devices[39].commands.allow.size(), 2U);
  EXPECT_TRUE(config.warnings.empty()) << config.warnings.front();
}

TEST(Templates, RangesAndLists) {
  const auto made = [](const char* n) {
    json plant = meters();
    plant["templates"]["meter"].erase("commands");
    plant["devices"][0] = {{"template", "meter"}, {"name", "m{n}"}, {"link", "line1"}};
    plant["devices"][0]["n"] = json::parse(n);
    return names(good(plant.dump()));
  };
  EXPECT_EQ(made(R"("7")"), (Strings{"m7"}));
  EXPECT_EQ(made(R"("9-11")"), (Strings{"m9", "m10", "m11"}));
  EXPECT_EQ(made(R"("08-10,12")"), (Strings{"m08", "m09", "m10", "m12"}));
  EXPECT_EQ(made(R"([3, "north", "s_1"])"), (Strings{"m3", "mnorth", "ms_1"}));
}

TEST(Templates, ANumberWithZerosIsANumberWhereOneIsAsked) {
  const Config config = good(with("/devices/0/n", R"("07-08")"));
  EXPECT_EQ(names(config), (Strings{"meter07", "meter08"}));
  EXPECT_EQ(unit_of(config.devices[1]), 8);
}

struct TemplatesTest : ::testing::Test {
  json plant = meters();
};

TEST_F(TemplatesTest, KeysOfTheDeviceWin) {
  plant["devices"][0]["timeout_ms"] = 700;
  plant["devices"][0]["commands"] = {{"queue", 5}};
  const Config config = good(plant.dump());
  EXPECT_EQ(config.devices[0].timeout.count(), 700);
  EXPECT_EQ(config.devices[0].commands.queue, 5U);
  EXPECT_TRUE(config.devices[0].commands.allow.empty());
}

TEST(Templates, EveryKeyOfATemplateIsOneOfItsDevices) {
  const std::map<std::string_view, json> values{
      {"link", "gw1"},         {"protocol", "fx-computer-link"},
      {"model", "FX2N"},       {"timeout_ms", 700},
      {"retries", 7},          {"gap_ms", 9},
      {"turnaround_ms", 77},   {"echo", true},
      {"max_block_bytes", 32}, {"enquire", "never"}};
  const std::set<std::string_view> others{"name", "template", "n", "groups", "tags", "commands"};
  json plain = small_plant();
  plain["devices"].erase(1);
  std::set<std::string_view> keys{"enquire"};  // an option of the protocol
  for (const ConfigKey& key : config_section("devices[]"))
    if (!others.contains(key.name)) keys.insert(key.name);
  for (const std::string_view key : keys) {
    SCOPED_TRACE(key);
    const json& value = values.at(key);
    json written = plain;
    written["devices"][0][key] = value;
    if (key == "protocol") written["devices"][0]["station"] = 3;
    json made = written;
    made["templates"] = {{"t", {{key, value}}}};
    made["devices"][0].erase(key);
    made["devices"][0]["template"] = "t";
    const Config by_template = good(made.dump());
    EXPECT_TRUE(change_between(good(written.dump()), by_template).empty());
    EXPECT_FALSE(change_between(good(plain.dump()), by_template).empty());
  }
}

TEST_F(TemplatesTest, GroupsAndTagsAreAddedAndReplacedByName) {
  plant["devices"][0]["groups"] =
      json::parse(R"([{"name": "fast", "interval_ms": 100}, {"name": "slow", "interval_ms": 9}])");
  plant["devices"][0]["tags"] = json::parse(R"([
      {"name": "alarm", "address": "di:{n}", "group": "fast"},
      {"name": "power", "address": "ir:{n}0", "group": "slow"}])");
  const Config config = good(plant.dump());
  const DeviceConfig& second = config.devices[1];
  ASSERT_EQ(second.groups.size(), 2U);
  EXPECT_EQ(second.groups[0].name, "slow");
  EXPECT_EQ(second.groups[0].interval.count(), 9);
  EXPECT_EQ(second.groups[1].name, "fast");
  EXPECT_EQ(tags(second), (Strings{"power=ir:20", "energy=ir:342", "alarm=di:2"}));
  EXPECT_EQ(tags(config.devices[0])[0], "power=ir:10");
}

TEST_F(TemplatesTest, TagsOfTheSameNameAreFoundAfterNIsPutIn) {
  plant["templates"]["meter"]["tags"][0]["name"] = "power{n}";
  plant["devices"][0]["tags"] = json::parse(R"([{"name": "power2", "address": "ir:99"}])");
  plant["devices"][0]["n"] = "1-2";
  const Config config = good(plant.dump());
  EXPECT_EQ(tags(config.devices[0]), (Strings{"power1=ir:12", "energy=ir:342", "power2=ir:99"}));
  EXPECT_EQ(tags(config.devices[1]), (Strings{"power2=ir:99", "energy=ir:342"}));
}

TEST_F(TemplatesTest, ATemplateWithoutNMakesOneDevice) {
  plant["templates"]["meter"].erase("commands");
  plant["devices"] = json::parse(R"([
      {"template": "meter", "name": "a", "link": "line1", "unit": 1},
      {"template": "meter", "name": "b", "link": "line1", "unit": 2, "timeout_ms": 5}])");
  const Config config = good(plant.dump());
  EXPECT_EQ(names(config), (Strings{"a", "b"}));
  EXPECT_EQ(config.devices[0].timeout.count(), 300);
  EXPECT_EQ(config.devices[1].timeout.count(), 5);
}

TEST_F(TemplatesTest, NNeedsNoTemplate) {
  plant.erase("templates");
  plant["devices"] = json::parse(R"([{"name": "m{n}", "n": [4, 5], "link": "line1", "unit": "{n}",
                                      "protocol": "modbus-rtu"}])");
  const Config config = good(plant.dump());
  EXPECT_EQ(names(config), (Strings{"m4", "m5"}));
  EXPECT_EQ(unit_of(config.devices[1]), 5);
}

TEST_F(TemplatesTest, AllMayStandInTheTemplate) {
  json& meter = plant["templates"]["meter"];
  meter["name"] = "meter{n}";
  meter["link"] = "line1";
  meter["unit"] = "{n}";
  plant["devices"] = json::parse(R"([{"template": "meter", "n": "1-3"}])");
  EXPECT_EQ(names(good(plant.dump())), (Strings{"meter1", "meter2", "meter3"}));
}

TEST(Templates, ARangeOfNIsWrittenAsOneOfAddresses) {
  for (const char* same : {R"("1..3")", R"("1 - 3")", R"("1..2, 3")"})
    EXPECT_EQ(names(good(with("/devices/0/n", same))),
              names(good(with("/devices/0/n", R"("1-3")"))))
        << same;
}

TEST_F(TemplatesTest, VariablesAndNDoNotDisturbEachOther) {
  plant["templates"]["meter"]["tags"] = json::parse(R"([
      {"name": "a", "address": "ir:${n}"},
      {"name": "b", "address": "ir:${REG_{n}}"},
      {"name": "c", "address": "ir:{n}${TAIL}"},
      {"name": "d", "address": "ir:1", "unit": "$${n}"},
      {"name": "e", "address": "ir:1", "unit": "${WITH}"}])");
  plant["devices"][0]["n"] = "4-5";
  const auto from = environment(
      {{"n", "70"}, {"REG_4", "400"}, {"REG_5", "500"}, {"TAIL", "9"}, {"WITH", "{n}"}});
  const Config config = good(plant.dump(), from);
  const DeviceConfig& device = config.devices[1];
  EXPECT_EQ(tags(device), (Strings{"a=ir:70", "b=ir:500", "c=ir:59", "d=ir:1", "e=ir:1"}));
  EXPECT_EQ(device.tags[3].units->unit, "${n}");
  EXPECT_EQ(device.tags[4].units->unit, "{n}");
}

TEST(Templates, APlainDeviceKeepsItsBraces) {
  json plant = small_plant();
  plant["devices"][0]["tags"][0]["unit"] = "{n}";
  EXPECT_EQ(good(plant.dump()).devices[0].tags[0].units->unit, "{n}");
}

TEST(Templates, TheRangeMayComeFromTheEnvironment) {
  const Config config =
      good(with("/devices/0/n", R"("1-${METERS}")"), environment({{"METERS", "3"}}));
  EXPECT_EQ(config.devices.size(), 3U);
}

// ---- errors -----------------------------------------------------------------------------------

TEST_F(TemplatesTest, AnErrorInATemplateIsToldOnceAndNamesBothPlaces) {
  plant["templates"]["meter"]["tags"][1]["address"] = "xx:1";
  const std::string text = plant.dump(1);
  expect_error(text, "/templates/meter/tags/1/address",
               {"for the device at /devices/0 (line ", "{n} being 1, and for 39 others"});
  const auto errors = errors_of(text);
  const auto line =
      std::count(text.begin(), text.begin() + static_cast<long>(text.find("xx:1")), '\n');
  EXPECT_EQ(errors[0].line, 1 + line);
}

TEST(Templates, AnErrorOfTheDeviceNamesItsTemplate) {
  expect_error(with("/devices/0/link", R"("line2")"), "/devices/0/link",
               {"there is no link \"line2\"", "did you mean line1?",
                "its template is at /templates/meter (line ", "{n} being 1, and for 39 others"});
}

TEST(Templates, TheFirstNumberThatIsWrongIsNamed) {
  expect_error(with("/devices/0/n", R"("245-250")"), "/devices/0/unit",
               {"unit must be 1 to 247", "{n} being 248", "and for 2 others"});
  expect_error(with("/devices/0/n", R"("256-260")"), "/devices/0/unit",
               {"must be an integer from 0 to 255, found the string \"{n}\"", "{n} being 256",
                "and for 4 others"});
}

TEST_F(TemplatesTest, EntriesOfOneTemplateShareItsError) {
  plant["templates"]["meter"].erase("commands");
  plant["templates"]["meter"]["tags"][0]["type"] = "float";
  plant["devices"] = json::parse(R"([
      {"template": "meter", "name": "a", "link": "line1", "unit": 1},
      {"template": "meter", "name": "b", "link": "line1", "unit": 2}])");
  expect_error(plant.dump(), "/templates/meter/tags/0/type", {"/devices/0", "and for 1 other"});
}

TEST_F(TemplatesTest, WhatNeitherHasIsMissingAtTheDevice) {
  plant["templates"]["meter"].erase("protocol");
  plant["templates"]["meter"].erase("tags");
  plant["templates"]["meter"].erase("commands");
  plant["devices"][0].erase("unit");
  expect_error(plant.dump(), "/devices/0",
               {"\"protocol\" is missing", "its template is at /templates/meter"});
}

TEST(Templates, AnUnknownOneNamesTheNearest) {
  expect_error(with("/devices/0/template", R"("metre")"), "/devices/0/template",
               {"there is no template \"metre\"; did you mean meter?"});
  json plant = meters();
  plant.erase("templates");
  expect_error(plant.dump(), "/devices/0/template", {"the config has no templates"});
}

TEST_F(TemplatesTest, AnUnusedOneIsAWarningAndItsKeysAreChecked) {
  plant["templates"]["pump"] = json::object();
  EXPECT_TRUE(warns(good(plant.dump()), {"/templates/pump", "no device uses this template"}));
  plant["templates"]["pump"]["timeout"] = 5;
  expect_error(plant.dump(), "/templates/pump/timeout", {"unknown key", "timeout_ms"});
}

TEST(Templates, TheyDoNotNest) {
  expect_error(with("/templates/meter/template", R"("pump")"), "/templates/meter/template",
               {"cannot use another template"});
  expect_error(with("/templates/meter/n", R"("1-2")"), "/templates/meter/n",
               {"belongs to the device that uses the template"});
}

TEST_F(TemplatesTest, WhatIsNoTemplateIsRefused) {
  plant["templates"] = json::array();
  plant["devices"] = json::array();
  expect_error(plant.dump(), "/templates", {"must be an object"});
  plant["templates"] = {{"a", 5}};
  expect_error(plant.dump(), "/templates/a", {"must be an object with keys of a device"});
  plant["templates"] = {{"A b", json::object()}};
  expect_error(plant.dump(), "/templates/A b", {"a name is 1 to 64"});
}

TEST(Templates, OneNameTwice) {
  expect_error(R"({"agent": {"id": "a"}, "mqtt": {"servers": ["mqtt://a"]}, "links": [],
                   "devices": [], "templates": {"m": {}, "m": {}}})",
               "/templates/m", {"duplicate template", "/templates/m (line 2)"});
}

TEST(Templates, NThatIsNoneIsRefused) {
  for (const char* n :
       {R"("")", R"("a-b")", R"("1-")", R"("-3")", R"("1,,2")", R"("1 3")", R"("1-3-5")",
        R"("12345678901")", R"("north")", "5", "true", "null", "{}"}) {
    SCOPED_TRACE(n);
    expect_error(with("/devices/0/n", n), "/devices/0/n", {});
  }
  expect_error(with("/devices/0/n", R"("north")"), "/devices/0/n",
               {"must be a range such as \"1-40\"", "found \"north\""});
  expect_error(with("/devices/0/n", R"("5-3")"), "/devices/0/n",
               {"range 5-3 ends before it begins"});
  expect_error(with("/devices/0/n", "[]"), "/devices/0/n", {"at least one"});
  expect_error(with("/devices/0/n", R"(["a", "B", "c"])"), "/devices/0/n/1",
               {"must be an integer or a name"});
  expect_error(with("/devices/0/n", "[1, 1.5]"), "/devices/0/n/1",
               {"must be an integer or a name"});
}

TEST(Templates, TooManyAreRefused) {
  for (const char* n : {R"("1-10001")", R"("1-999999999")", R"("1-6000,1-6000")"})
    expect_error(with("/devices/0/n", n), "/devices/0/n", {"makes more than 10000 devices"});
  json plant = meters();
  plant["templates"]["meter"]["tags"][0]["unit"] = std::string(8000, 'x');
  plant["devices"][0]["n"] = "1-10000";
  plant["devices"][0].erase("unit");
  expect_error(plant.dump(), "/devices/0", {"would be larger than 64 MiB"});
}

TEST_F(TemplatesTest, AllowedAddressesCountAmongTheBytes) {
  json& allow = plant["templates"]["meter"]["commands"]["allow"];
  for (int coil = 0; coil < 65536; coil += 2) allow.push_back("co:" + std::to_string(coil));
  plant["devices"][0]["n"] = "1-10000";
  plant["devices"][0].erase("unit");
  expect_error(plant.dump(), "/devices/0", {"would be larger than 64 MiB"});
}

TEST_F(TemplatesTest, PlacesOfNCountAsLongAsTheNamesAre) {
  plant["templates"]["meter"].erase("commands");
  std::string places;
  for (int i = 0; i < 1000; ++i) places += "{n}";
  plant["templates"]["meter"]["tags"][0]["unit"] = places;
  plant["devices"][0].erase("unit");
  json names = json::array();
  for (int i = 1000; i < 2200; ++i) names.push_back(std::string(60, 'x') + std::to_string(i));
  plant["devices"][0]["n"] = names;
  plant["devices"][0]["name"] = "{n}";
  expect_error(plant.dump(), "/devices/0", {"would be larger than 64 MiB"});
}

TEST(Templates, TheNameNeedsN) {
  expect_error(with("/devices/0/name", R"("meter")"), "/devices/0/name",
               {"the name must contain {n}: 40 devices come from the entry at /devices/0"});
}

TEST_F(TemplatesTest, ANameWithoutNHidesNoFaultOfTheTags) {
  plant["devices"][0]["name"] = "meter";
  plant["templates"]["meter"]["tags"][0]["address"] = "ir:x";
  const auto errors = errors_of(plant.dump(1));
  ASSERT_EQ(errors.size(), 2U) << listed(errors);
  EXPECT_EQ(errors[0].pointer, "/devices/0/name");
  EXPECT_EQ(errors[1].pointer, "/templates/meter/tags/0/address");
}

TEST_F(TemplatesTest, NThatIsNotGivenIsMissed) {
  plant["devices"][0].erase("n");
  const auto errors = errors_of(plant.dump());
  ASSERT_EQ(errors.size(), 3U) << listed(errors);  // in allow, the name and the unit
  EXPECT_EQ(errors[2].pointer, "/templates/meter/commands/allow/0");
  EXPECT_NE(errors[2].text.find("{n} has no value: the device has no \"n\""), std::string::npos);
}

TEST_F(TemplatesTest, ANameIsNoNumber) {
  plant["templates"]["meter"].erase("commands");
  plant["devices"][0]["n"] = {"north"};
  expect_error(plant.dump(), "/devices/0/unit",
               {"must be an integer from 0 to 255, found the string \"{n}\"", "{n} being north"});
}

TEST(Templates, KeysTwiceAndUnknownKeysAreFoundInBoth) {
  std::string text = meters().dump();
  text.replace(text.find("\"timeout_ms\":300"), 16, "\"timeout_ms\":300,\"timeout_ms\":301");
  expect_error(text, "/templates/meter/timeout_ms", {"duplicate"});
  expect_error(with("/templates/meter/colour", "1"), "/templates/meter/colour", {"unknown key"});
  expect_error(with("/devices/0/colour", "1"), "/devices/0/colour", {"unknown key"});
}

TEST_F(TemplatesTest, OneDeviceNameFromTwoEntries) {
  plant["devices"].push_back(plant["devices"][0]);
  expect_error(plant.dump(), "/devices/1/name", {"is already used as a name at /devices/0/name"});
}

TEST_F(TemplatesTest, NoErrorTellsWhatTheEnvironmentHas) {
  plant["templates"]["meter"]["tags"][0]["address"] = "${SECRET}{n}";
  const auto errors = errors_of(plant.dump(), environment({{"SECRET", "hunter2"}}));
  ASSERT_EQ(errors.size(), 1U) << listed(errors);
  EXPECT_EQ(errors[0].text.find("hunter2"), std::string::npos) << errors[0].text;
}

TEST_F(TemplatesTest, WarningsAreToldOnceToo) {
  plant["templates"]["meter"]["tags"][0]["max"] = 99999;
  const Config config = good(plant.dump());
  ASSERT_EQ(config.warnings.size(), 1U);
  EXPECT_NE(config.warnings[0].find("and for 39 others"), std::string::npos) << config.warnings[0];
}

TEST(Templates, EqualUnitsAreSeen) {
  const Config config = good(with("/devices/0/unit", "7"));
  EXPECT_TRUE(warns(config, {"/devices/0/unit", "unit 7 is that of /devices/0", "38 others"}));
}

}  // namespace
}  // namespace fxagent
