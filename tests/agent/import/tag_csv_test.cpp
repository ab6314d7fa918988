// Tags exported to CSV and imported again give the same config.

#include <gtest/gtest.h>

#include "agent/config/json/tree.h"
#include "agent/config/keys.h"
#include "agent/import/csv.h"
#include "tests/agent/config/small_plant.h"
#include "tests/agent/import/outcome.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;

std::string text_of(const std::string& path) {
  std::string text = content_of(path);
  EXPECT_FALSE(text.empty()) << path;
  return text;
}

/// Returns the re-imported config as JSON.
json back(const std::string& config) {
  auto imported = import_tag_csv(export_csv(config), {});
  EXPECT_TRUE(imported) << (imported ? "" : imported.error().text);
  if (!imported) return {};
  EXPECT_TRUE(imported->notes.empty()) << imported->notes.front().text;
  const ImportOutcome outcome = finish(*std::move(imported));
  EXPECT_TRUE(outcome.notes.empty()) << outcome.notes.front().text;
  return json::parse(outcome.config.empty() ? "null" : outcome.config);
}

/// A device whose tags have every possible key.
json every_key() {
  json plant = small_plant();
  plant["devices"][0]["tags"] = json::parse(R"([
    {"name": "all", "address": "D100", "type": "int32", "count": 2, "word_order": "high_first",
     "scale": 0.25, "offset": -1.5, "unit": "\"°C\", ;x", "min": -10, "max": 1e3, "deadband": 0.125,
     "group": "fast", "access": "read_write",
     "description": "Speed, \"left\" press", "states": {"0": "idle, \"off\"", "-1": "jam"}},
    {"name": "text", "address": "D200", "type": "string", "length": 9, "unit": ""},
    {"name": "bit", "address": "M0", "type": "bool", "unit": " $${X} "},
    {"name": "plain", "address": "X17"}])");
  return plant;
}

TEST(TagCsv, EveryKeyHasAColumnAndComesBack) {
  const json plant = every_key();
  std::set<std::string> seen;
  for (const json& tag : plant["devices"][0]["tags"])
    for (const auto& [key, value] : tag.items()) seen.insert(key);
  for (const ConfigKey& key : config_section("devices[].tags[]"))
    EXPECT_TRUE(seen.contains(std::string(key.name))) << key.name << " is not tried here";
  EXPECT_EQ(back(plant.dump()), plant);
  const std::string csv = export_csv(plant.dump());
  EXPECT_EQ(csv.find("#press1"), std::string::npos) << csv;
  EXPECT_NE(csv.find(R"(press1,all,D100,int32,2,,)"), std::string::npos) << csv;
}

TEST(TagCsv, TheConfigsOfTheProjectComeBack) {
  const json example = json::parse(text_of(FXAGENT_CONFIG_DIR "/agent.example.json"));
  EXPECT_EQ(back(example.dump()), example);
}

TEST(TagCsv, PasswordOfAPrivateConfigComesBack) {
  json plant = small_plant();
  plant["mqtt"]["password"] = "hunter2";
  EXPECT_EQ(back(plant.dump()), plant);
}

TEST(TagCsv, MoreValuesThanATreeUsuallyHasAreExported) {
  std::string text = R"({"store": [)";
  for (std::size_t i = 0; i < TreeBounds::most_nodes; ++i) text += "0,";
  EXPECT_TRUE(export_csv(text + "1]}").ends_with("0,1]\"\n"));
}

TEST(TagCsv, EmptyListsAndDevicesWithoutTagsComeBack) {
  json plant = small_plant();
  plant["devices"][1]["tags"] = json::array();
  plant["devices"][1]["groups"] = json::array();
  EXPECT_EQ(back(plant.dump()), plant);
  plant["devices"] = json::array();
  EXPECT_EQ(back(plant.dump()), plant);
}

TEST(TagCsv, TemplatesComeBack) {
  const json plant = json::parse(R"({
    "agent": {"id": "edge7"}, "mqtt": {"servers": ["mqtt://127.0.0.1:1883"]},
    "links": [{"name": "l1", "tcp": {"host": "192.0.2.1", "port": 502}}],
    "templates": {"meter": {"protocol": "modbus-tcp", "link": "l1", "tags": [
      {"name": "t", "address": "hr:{n}", "min": "{n}"}]}},
    "devices": [
      {"template": "meter", "name": "m{n}", "n": "1-3", "unit": "{n}",
       "tags": [{"name": "own", "address": "hr:9", "max": "{n}"}]},
      {"template": "meter", "name": "m{n}", "n": [4, 5], "unit": "{n}",
       "tags": [{"name": "own", "address": "hr:9"}]},
      {"template": "meter", "name": "single", "unit": 9, "n": "7",
       "tags": [{"name": "own", "address": "hr:8"}]}]})");
  EXPECT_EQ(back(plant.dump()), plant);
}

TEST(TagCsv, IsATableWithTheDeviceFirst) {
  json plant = small_plant();
  const std::string csv = export_csv(plant.dump());
  EXPECT_TRUE(csv.starts_with(
      "device,name,address,type,count,length,word_order,scale,offset,unit,description,states,min,"
      "max,deadband,group,"
      "access\npress1,temp,D100,,,,,,,,,,,,,fast,\npress1,running,M0,bool,,,,,,,,,,,,,\n#agent,"))
      << csv;
}

TEST(TagCsv, NumbersStayAsTheyAreSpelled) {
  const std::string csv = export_csv(
      R"({"agent":{"id":"e"},"mqtt":{"servers":["mqtt://a"]},"links":[{"name":"l","serial":{"path":"/d"}}],
          "devices":[{"name":"d","link":"l","protocol":"modbus-rtu","tags":[
            {"name":"t","address":"hr:0","scale":0.10}]}]})");
  EXPECT_NE(csv.find(",0.10,"), std::string::npos) << csv;
}

TEST(TagCsv, CommentsOfTheConfigAreLeftOut) {
  const std::string text = small_plant().dump(1);
  EXPECT_EQ(export_csv("// plant\n" + text + "/* end */"), export_csv(text));
}

TEST(TagCsv, RowsMayBeChangedAndAdded) {
  std::string csv = export_csv(small_plant().dump());
  csv.replace(csv.find("D100"), 4, "D111");
  csv.insert(csv.find("#agent"), "mixer,new,D5,,,,,,,,,,,,\n");
  const Made made = made_of(csv, import_tag_csv);
  EXPECT_EQ(made.config["devices"][0]["tags"][0]["address"], "D111");
  EXPECT_EQ(made.config["devices"][1]["tags"][0]["name"], "new");
}

TEST(TagCsv, ATableOfTagsAloneMakesADevice) {
  const Made made = made_of("name;address;scale;group;colour\na;hr:1;0.5;slow;red\nb;xx;;;\n",
                            import_tag_csv, {"meter", "modbus-rtu", "", "/dev/ttyUSB0"});
  const json& device = made.config["devices"][0];
  EXPECT_EQ(device["name"], "meter");
  EXPECT_EQ(device["groups"], json::parse(R"([{"name": "slow"}])"));
  EXPECT_EQ(device["tags"],
            json::parse(R"([{"name":"a","address":"hr:1","scale":0.5,"group":"slow"}])"));
  expect_note(made, {"1: left out: the column \"colour\""});
  expect_note(made, {"3: left out", "xx"});
}

TEST(TagCsv, RowsOfSeveralDevicesMakeEachOfThem) {
  const Made made =
      made_of("device,name,address,group\na,t1,hr:1,fast\nb,t2,hr:2,fast\na,t3,hr:3,slow\n",
              import_tag_csv, {"", "modbus-tcp", "", "192.0.2.7:502"});
  ASSERT_EQ(made.config["devices"].size(), 2U);
  const auto names = [&](std::size_t device) {
    std::vector<std::string> list;
    for (const json& tag : made.config["devices"][device]["tags"]) list.push_back(tag["name"]);
    return list;
  };
  EXPECT_EQ(names(0), (std::vector<std::string>{"t1", "t3"}));
  EXPECT_EQ(names(1), (std::vector<std::string>{"t2"}));
  EXPECT_EQ(made.config["devices"][1]["groups"], json::parse(R"([{"name": "fast"}])"));
  EXPECT_EQ(made.config["links"].size(), 1U);
}

TEST(TagCsv, AnExportOfTwoDevicesHasTheTagsOfBothUnderTheirNames) {
  json plant = small_plant();
  plant["devices"][1]["tags"] = json::parse(R"([{"name": "level", "address": "D5"}])");
  const auto rows = read_csv(export_csv(plant.dump()));
  ASSERT_TRUE(rows);
  std::vector<std::string> owners;
  for (const CsvRow& row : *rows)
    if (!row.at(0).starts_with('#') && row.line > 1) owners.emplace_back(row.at(0));
  std::vector<std::string> expected;
  for (const json& device : plant["devices"])
    for (std::size_t i = 0; i < device.value("tags", json::array()).size(); ++i)
      expected.push_back(device["name"]);
  EXPECT_GT(std::set<std::string>(owners.begin(), owners.end()).size(), 1U);
  EXPECT_EQ(owners, expected);
}

TEST(TagCsv, ASpreadsheetMaySaveItWithSemicolons) {
  const auto rows = read_csv(export_csv(small_plant().dump()));
  ASSERT_TRUE(rows);
  std::string text;
  for (const CsvRow& row : *rows) {
    for (std::size_t i = 0; i < row.cells.size(); ++i)
      text += (i > 0 ? ";" : "") + csv_cell(row.cells[i]);
    text += "\r\n";
  }
  EXPECT_EQ(made_of(text, import_tag_csv).config, small_plant());
}

TEST(TagCsv, ARowOfADeviceThatIsNotThereIsTold) {
  std::string csv = export_csv(small_plant().dump());
  csv.insert(csv.find("#agent"), "mixre,new,D5,,,,,,,,,,,,\n");
  const Made made = made_of(csv, import_tag_csv);
  expect_note(made, {"4: left out: there is no device mixre"});
  EXPECT_EQ(made.config, small_plant());
}

TEST(TagCsv, WhatIsNoNumberIsTold) {
  const Made made =
      made_of("device,name,address,scale\nd,a,D0,x\nd,b,D1,2\nd,c,D2,\"0,1\"\n", import_tag_csv);
  EXPECT_EQ(made.config["devices"][0]["tags"].size(), 1U);
  expect_note(made, {"2: left out: \"a\": scale: must be a number, found the string \"x\""});
  expect_note(made, {"4: scale \"0,1\": write a decimal point"});
}

TEST(TagCsv, EveryFaultOfARowIsTold) {
  const Made made = made_of(
      "device,name,address,type,scale,access\nd,a,D0,flot,\"0,1\",rw\nd,b,D1,,,\n", import_tag_csv);
  expect_note(made, {"2: left out: \"a\"", "type: must be", "scale: must be", "access: must be"});
  EXPECT_EQ(made.left_out, 1U);
}

TEST(TagCsv, AFaultNamesItsKeyOnce) {
  const Made made = made_of(
      "device,name,address,type,states,access\n"
      "d,a,D0,string,,\n"
      "d,b,D1,,\"{\"\"5\"\": 5}\",\n"
      "d,c,D2,,,rw\n",
      import_tag_csv);
  expect_note(made, {"2: left out: \"a\": \"length\" is missing"});
  expect_note(made, {"3: left out: \"b\": states/5: must be"});
  expect_note(made, {"4: not imported: the access of \"c\": must be"});
}

TEST(TagCsv, NamesAreMadeValid) {
  const Made made =
      made_of("device,name,address\nd,Flow,D0\nd,Motor 1,D1\ne,Flow,D2\n", import_tag_csv);
  const json& devices = made.config["devices"];
  EXPECT_EQ(devices[0]["tags"][0]["name"], "flow");
  EXPECT_EQ(devices[0]["tags"][1]["name"], "motor_1");
  EXPECT_EQ(devices[1]["tags"][0]["name"], "flow");
  expect_note(made, {"3: \"Motor 1\" is named motor_1"});
}

TEST(TagCsv, AValidNameIsNotLostToAnotherRow) {
  const Made made = made_of(
      "device,name,address,type,scale\n"
      "d,Flow,D0,,\n"
      "d,flow,D1,,\n"
      "d,x,D2,,\"0,1\"\n"
      "d,x,D3,,\n"
      "d,x,D4,,\n"
      "d,Y,D5,flot,\n"
      "d,Y,P0,,\n"
      "d,Y,D6,,\n",
      import_tag_csv);
  std::map<std::string, std::string> names;
  for (const json& tag : made.config["devices"][0]["tags"]) names[tag["address"]] = tag["name"];
  EXPECT_EQ(names, (std::map<std::string, std::string>{
                       {"D0", "flow_2"}, {"D1", "flow"}, {"D3", "x"}, {"D4", "x_2"}, {"D6", "y"}}));
  expect_note(made, {"2: \"Flow\" is named flow_2: the name was already used"});
  expect_note(made, {"7: left out: \"Y\": type: must be"});
  EXPECT_EQ(made.changed, 2U);
}

/// A config lists 1,000 errors: names that are made valid must not hide those of values.
TEST(TagCsv, ManyInvalidNamesHideNoOtherFault) {
  std::string text = "name,address\n";
  for (int i = 0; i < 1500; ++i)
    text += "Tag " + std::to_string(i) + ",D" + std::to_string(i) + "\n";
  const Made made = made_of(text + "Pump 1,X8\nPump-1,X7\nPump.1,D7\n", import_tag_csv);
  EXPECT_EQ(made.left_out, 1U);
  EXPECT_EQ(made.changed, 1501U);
  const auto& tags = made.config["devices"][0]["tags"];
  ASSERT_EQ(tags.size(), 1502U);
  EXPECT_EQ(tags[1500]["name"], "pump-1");
  EXPECT_EQ(tags[1501]["name"], "pump_1") << "the row that is left out has no name";
}

TEST(TagCsv, BrokenJsonIsTold) {
  const Made made = made_of("device,name,address\nd,a,D0\n#store,{\n", import_tag_csv);
  expect_note(made, {"3: left out", "not JSON"});
}

TEST(TagCsv, ARowThatCannotBeASectionIsTold) {
  std::string csv = export_csv(small_plant().dump());
  csv += "#device,\"{\"\"name\"\": \"\"p\"\", \"\"tags\"\": 5}\"\n#links,[]\n";
  const Made made = made_of(csv, import_tag_csv);
  expect_note(made, {"left out: tags must be an array"});
  expect_note(made, {"left out: links have a row each, #link or #device"});
  EXPECT_EQ(made.config, small_plant());
}

}  // namespace
}  // namespace fxagent
