#include "agent/import/imported.h"
#include "agent/text/json.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "agent/import/formats.h"

namespace fxagent {
namespace {

using nlohmann::json;

TEST(JsonObject, IsJsonWhateverComesIn) {
  JsonObject object;
  object["a\"b"] = "c\n\xFF";
  object["n"] = json_number(0.1);
  object["i"] = -5;
  EXPECT_EQ(dumped(object), "{\"a\\\"b\":\"c\\n\uFFFD\",\"n\":0.1,\"i\":-5}");
}

TEST(JsonObject, AWholeNumberHasNoFraction) {
  EXPECT_EQ(dumped(json_number(-10)), "-10");
  EXPECT_EQ(dumped(json_number(1e6)), "1000000");
  EXPECT_EQ(dumped(json_number(1e17)), "1e+17");
  EXPECT_EQ(dumped(json_number(0.5)), "0.5");
}

TEST(JsonObject, ANumberThatIsNoneIsNull) {
  JsonObject object;
  object["a"] = json_number(std::numeric_limits<double>::infinity());
  object["b"] = json_number(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(dumped(object), R"({"a":null,"b":null})");
}

TEST(JsonObject, ATextOfOthersIsNoVariable) {
  EXPECT_EQ(literal("${HOME} $ {x} $${b}"), "$${HOME} $ {x} $$${b}");
}

TEST(NameMaker, MakesNames) {
  NameMaker names;
  std::vector<ImportNote> notes;
  EXPECT_EQ(names.make("Motor Start", "d0", 1, notes), "motor_start");
  EXPECT_EQ(names.make("Line1.Temp[3]", "d0", 1, notes), "line1_temp_3");
  EXPECT_EQ(names.make("a-b_c", "d0", 1, notes), "a-b_c");
  EXPECT_TRUE(notes.empty());
}

TEST(NameMaker, TellsWhatIsLost) {
  NameMaker names;
  std::vector<ImportNote> notes;
  EXPECT_EQ(names.make("温度", "d100", 7, notes), "d100");
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_EQ(notes[0].line, 7);
  EXPECT_EQ(notes[0].text, "\"温度\" is named d100: a name has only a-z, 0-9, _ and -");
  EXPECT_EQ(names.make("Temp °C", "d1", 8, notes), "temp_c");
  EXPECT_EQ(names.make("temp_c", "d1", 9, notes), "temp_c_2");
  EXPECT_EQ(names.make("TEMP_C", "d1", 9, notes), "temp_c_3");
  EXPECT_NE(notes.back().text.find("the name was already used"), std::string::npos);
  EXPECT_EQ(names.make(std::string(70, 'x'), "d1", 9, notes).size(), 64U);
  EXPECT_EQ(names.make(std::string(70, 'x'), "d1", 9, notes).size(), 64U);
}

TEST(LinkTable, OneLinkForOnePort) {
  Imported out;
  LinkTable links(out);
  EXPECT_EQ(links.to("192.0.2.1:502", "modbus-tcp"), "line1");
  EXPECT_EQ(links.to("/dev/ttyUSB0", "modbus-rtu"), "line2");
  EXPECT_EQ(links.to("192.0.2.1:502", "modbus-tcp"), "line1");
  EXPECT_EQ(links.to("[::1]:502", "modbus-tcp"), "line3");
  links.to("192.0.2.2:0502", "modbus-tcp");
  EXPECT_EQ(links.to("/dev/ttyUSB0", "modbus-ascii"), "line2");
  ASSERT_EQ(out.links.size(), 4U);
  EXPECT_EQ(out.links[0]["tcp"]["port"], 502);
  EXPECT_EQ(out.links[2]["tcp"]["host"], "::1");
  EXPECT_EQ(out.links[3]["tcp"]["port"], 502);
}

TEST(LinkTable, ImpossiblePortIsAPlaceholder) {
  Imported out;
  LinkTable links(out);
  EXPECT_EQ(links.to("192.0.2.7:70000", "modbus-tcp", 3), "line1");
  EXPECT_EQ(links.to("192.0.2.7:0", "modbus-rtu", 4), "line2");
  ASSERT_EQ(out.links.size(), 2U);
  EXPECT_EQ(out.links[0]["tcp"]["host"], "192.0.2.1");
  EXPECT_EQ(out.links[1]["serial"], json::parse(R"({"path": "/dev/ttyUSB0"})"));
  ASSERT_EQ(out.notes.size(), 2U);
  EXPECT_EQ(out.notes[0].line, 3);
  EXPECT_EQ(out.notes[0].text,
            "not imported: the connection \"192.0.2.7:70000\", whose port is wrong; the link is a "
            "placeholder, 192.0.2.1:502: set the real one, as with --port");
}

TEST(LinkTable, WhatAPortIs) {
  EXPECT_EQ(LinkTable::is_serial("/dev/ttyS0"), true);
  EXPECT_EQ(LinkTable::is_serial("a:1"), false);
  for (const char* port : {"", "a", "a:", ":1", "a:0", "a:65536", "a:x", "COM1"})
    EXPECT_EQ(LinkTable::is_serial(port), std::nullopt) << port;
}

TEST(ModbusAddress, NamesTheTable) {
  EXPECT_EQ(modbus_address("co", 0), "co:0");
  EXPECT_EQ(modbus_address("ir", 65535), "ir:65535");
  EXPECT_EQ(modbus_address("hr", 65536), "");
  EXPECT_EQ(modbus_address("hr", -1), "");
  EXPECT_EQ(modbus_address("", 1), "");
}

ImportedTag tag(int line, const char* name, const char* address) {
  ImportedTag made{line, {}};
  made.keys["name"] = name;
  made.keys["address"] = address;
  return made;
}

Imported press(std::vector<ImportedTag> tags) {
  Imported out;
  ImportedDevice device = new_device(
      "press", LinkTable(out).to("/dev/ttyUSB0", "fx-programming-port"), "fx-programming-port");
  device.tags = std::move(tags);
  out.devices.push_back(std::move(device));
  return out;
}

TEST(FinishedImport, LeavesOutWhatTheConfigDoesNotTakeAndSaysWhy) {
  const auto outcome = finish(press({tag(2, "a", "D0"), tag(3, "b", "X8"), tag(4, "c", "M0"),
                                     tag(5, "d", "P0"), tag(6, "a", "D1")}));
  EXPECT_EQ(outcome.tags, 2U);
  ASSERT_EQ(outcome.notes.size(), 3U);
  EXPECT_EQ(outcome.notes[0].line, 3);
  EXPECT_TRUE(outcome.notes[0].text.starts_with("left out: \"b\": ")) << outcome.notes[0].text;
  EXPECT_NE(outcome.notes[0].text.find("X8"), std::string::npos);
  EXPECT_EQ(outcome.notes[2].line, 6);
  const json config = json::parse(outcome.config);
  EXPECT_EQ(config["devices"][0]["tags"].size(), 2U);
}

TEST(FinishedImport, ATagThatCanOnlyBeReadStaysWithoutItsAccess) {
  ImportedTag bit = tag(2, "bit", "D0.3");
  bit.keys["access"] = "read_write";
  const auto outcome = finish(press({bit}));
  EXPECT_EQ(outcome.tags, 1U);
  ASSERT_EQ(outcome.notes.size(), 1U);
  EXPECT_TRUE(outcome.notes[0].text.starts_with("not imported: the access of \"bit\": "))
      << outcome.notes[0].text;
}

TEST(FinishedImport, AnOddNumberOfALinkOrDeviceCostsNoOther) {
  Imported out;
  LinkTable links(out);
  JsonObject serial;
  serial["baud"] = 0;
  serial["parity"] = "even";
  const std::string line = links.to("/dev/ttyUSB0", "modbus-rtu", 0, serial);
  for (const int unit : {3, 300}) {
    ImportedDevice device = new_device("unit" + std::to_string(unit), line, "modbus-rtu");
    device.keys["unit"] = unit;
    device.keys["timeout_ms"] = 99'999'999;
    JsonObject group;
    group["name"] = "g";
    group["interval_ms"] = 99'999'999;
    device.groups.push_back(group);
    device.tags.push_back(tag(2, "a", "hr:0"));
    out.devices.push_back(std::move(device));
  }
  const auto outcome = finish(std::move(out));
  std::string notes;
  for (const ImportNote& note : outcome.notes) notes += note.text + "\n";
  ASSERT_EQ(outcome.tags, 1U) << notes;
  const json config = json::parse(outcome.config);
  EXPECT_EQ(config["links"][0]["serial"],
            json::parse(R"({"path": "/dev/ttyUSB0", "parity": "even"})"));
  ASSERT_EQ(config["devices"].size(), 1U);
  EXPECT_EQ(config["devices"][0]["unit"], 3);
  EXPECT_FALSE(config["devices"][0].contains("timeout_ms"));
  EXPECT_FALSE(config["devices"][0]["groups"][0].contains("interval_ms"));
  for (const char* what :
       {"not imported: baud of line1: ", "left out: the device unit300: unit: ",
        "not imported: timeout_ms of unit3: ", "not imported: interval_ms of unit3: "})
    EXPECT_NE(notes.find(what), std::string::npos) << what << "\n" << notes;
}

TEST(FinishedImport, ModelThatTheUsualProtocolDoesNotReachNamesTheOption) {
  ImportOptions options;
  options.model = "FX5U";
  options.port = "192.0.2.20:5007";
  const auto outcome = finish(*import_gx_comments("Device Name,Comment\nD0,speed\n", options));
  ASSERT_EQ(outcome.notes.size(), 2U);
  const std::string& note = outcome.notes[1].text;
  EXPECT_TRUE(note.starts_with("left out: the device plc1: model: fx-programming-port does not"))
      << note;
  EXPECT_TRUE(note.ends_with(" (--protocol names the protocol)")) << note;
}

TEST(FinishedImport, IsNothingWhereNoTagIsLeft) {
  const auto outcome = finish(press({tag(2, "a", "X8")}));
  EXPECT_EQ(outcome.config, "");
  EXPECT_EQ(outcome.notes.size(), 1U);
}

}  // namespace
}  // namespace fxagent
