// The tag CSV of KEPServerEX.
#include <gtest/gtest.h>

#include "tests/agent/import/outcome.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;

constexpr const char* kHead =
    "Tag Name,Address,Data Type,Respect Data Type,Client Access,Scan Rate,Scaling,Raw Low,Raw High,"
    "Scaled Low,Scaled High,Scaled Data Type,Clamp Low,Clamp High,Eng Units,Description,"
    "Negate Value\n";

Made made(const std::string& rows, const ImportOptions& options = {"d", "", "", "h:502"}) {
  return made_of(kHead + rows, import_kepware, options);
}

TEST(Kepware, ModbusTags) {
  const Made out = made(
      "\"Tank.Level\",\"400101\",Word,1,RO,1000,Linear,0,1000,0,10,Double,0,0,\"m\",\"\",0\n"
      "\"Pump\",\"000005\",Boolean,1,R/W,100,,,,,,,,,,\"\",\n"
      "\"Flow\",\"300007\",Float,1,RO,1000,,,,,,,,,,\"\",\n"
      "\"Alarm\",\"400103.4\",Boolean,1,RO,1000,,,,,,,,,,\"\",\n"
      "\"Block\",\"400110 [4]\",Short Array,1,RO,1000,,,,,,,,,,\"\",\n"
      "\"Text\",\"400200.20H\",String,1,RO,1000,,,,,,,,,,\"\",\n");
  const json& device = out.config["devices"][0];
  EXPECT_EQ(device["protocol"], "modbus-tcp");
  EXPECT_EQ(device["groups"], json::parse(R"([{"name":"every_1000_ms","interval_ms":1000},
                                              {"name":"every_100_ms","interval_ms":100}])"));
  EXPECT_EQ(device["tags"], json::parse(R"([
    {"name":"tank_level","address":"400101","type":"uint16","scale":0.01,"unit":"m","group":"every_1000_ms"},
    {"name":"pump","address":"000005","type":"bool","access":"read_write","group":"every_100_ms"},
    {"name":"flow","address":"300007","type":"float32","group":"every_1000_ms"},
    {"name":"alarm","address":"400103.4","type":"bool","group":"every_1000_ms"},
    {"name":"block","address":"400110","type":"int16","count":4,"group":"every_1000_ms"},
    {"name":"text","address":"400200","type":"string","length":20,"word_order":"high_first","group":"every_1000_ms"}
  ])"));
  expect_note(out, {"byte order"});
}

TEST(Kepware, FxTags) {
  const Made out = made(
      "\"Start\",\"X017\",Boolean,1,RO,100,,,,,,,,,,\"\",\n"
      "\"Speed\",\"D0100\",Short,1,R/W,100,Linear,0,100,20,120,Double,0,0,\"\",\"\",1\n",
      {"plc", "", "FX3U", "/dev/ttyUSB0"});
  const json& device = out.config["devices"][0];
  EXPECT_EQ(device["protocol"], "fx-programming-port");
  EXPECT_EQ(device["tags"][1]["scale"], -1);
  EXPECT_EQ(device["tags"][1]["offset"], -20);
}

TEST(Kepware, WhatCannotBeCarriedOverIsTold) {
  const Made out = made(
      "\"A\",\"400001\",Char,1,RO,100,,,,,,,,,,\"\",\n"
      "\"B\",\"400002\",Word,1,RO,100,Square Root,0,1,0,1,Double,0,0,\"\",\"\",0\n"
      "\"C\",\"400003\",Word,1,WO,100,Linear,0,1,0,2,Double,1,0,\"\",\"the pump\",0\n"
      "\"D\",\"H400004\",Word,1,RO,100,,,,,,,,,,\"\",\n"
      "\"E\",\"400005\",Word,1,RO,100,Linear,0,0,0,2,Double,1,0,\"\",\"\",0\n");
  EXPECT_EQ(out.config["devices"][0]["tags"].size(), 1U) << all_of(out.notes);
  expect_note(out, {"2: left out", "Char"});
  expect_note(out, {"3: left out", "square root"});
  expect_note(out, {"4: not imported", "write only"});
  expect_note(out, {"4: clamping is imported"});
  EXPECT_EQ(out.config["devices"][0]["tags"][0].value("description", ""), "the pump");
  expect_note(out, {"5: left out", "H400004"});
  expect_note(out, {"6: left out", "empty range"});
}

TEST(Kepware, ValuesOfFourRegistersHaveTheirType) {
  const Made out = made(
      "\"A\",\"400001\",LLong,1,RO,100,Linear,0,1000,0,1,Double,0,0,\"kWh\",\"\",0\n"
      "\"B\",\"400005\",QWord,1,RO,100,,,,,,,,,,\"\",\n"
      "\"C\",\"400009\",Double,1,RO,100,,,,,,,,,,\"\",\n"
      "\"D\",\"400013 [2]\",QWord Array,1,RO,100,,,,,,,,,,\"\",\n");
  EXPECT_EQ(out.config["devices"][0]["tags"], json::parse(R"([
    {"name":"a","address":"400001","type":"int64","scale":0.001,"unit":"kWh","group":"every_100_ms"},
    {"name":"b","address":"400005","type":"uint64","group":"every_100_ms"},
    {"name":"c","address":"400009","type":"float64","group":"every_100_ms"},
    {"name":"d","address":"400013","type":"uint64","count":2,"group":"every_100_ms"}])"));
  EXPECT_EQ(out.left_out, 0U);
}

TEST(Kepware, ClampsOfAWritableTagAreItsLimits) {
  const Made out = made(
      "\"SetTemp\",\"400001\",Word,1,R/W,100,Linear,0,1000,0,100,Double,1,1,\"\",\"\",0\n"
      "\"High\",\"400002\",Word,1,R/W,100,Linear,0,1000,0,100,Double,0,1,\"\",\"\",0\n"
      "\"Falling\",\"400003\",Word,1,R/W,100,Linear,0,1000,100,0,Double,1,0,\"\",\"\",0\n"
      "\"Negated\",\"400004\",Short,1,R/W,100,Linear,0,1000,0,100,Double,0,1,\"\",\"\",1\n"
      "\"Read\",\"400005\",Word,1,RO,100,Linear,0,1000,0,100,Double,1,1,\"\",\"\",0\n");
  const json& tags = out.config["devices"][0]["tags"];
  const auto limits = [&](std::size_t i) {
    return tags[i].value("min", json()).dump() + " " + tags[i].value("max", json()).dump();
  };
  EXPECT_EQ(limits(0), "0 100");
  EXPECT_EQ(limits(1), "null 100");
  EXPECT_EQ(limits(2), "null 100");
  EXPECT_EQ(limits(3), "-100 null");
  EXPECT_EQ(limits(4), "null null");
  expect_notes(4, out, {"clamping is imported as min and max", "is refused"});
  expect_note(out, {"6: not imported: clamping"});
}

TEST(Kepware, ANameWithOtherCharactersIsNoted) {
  const Made out = made(
      "\"Alarm.Over\",\"400001\",Word,1,RO,100,,,,,,,,,,\"\",\n"
      "\"Pump\",\"400002\",Word,1,RO,100,,,,,,,,,,\"\",\n");
  expect_note(out, {"2: \"Alarm.Over\" is named alarm_over"});
  EXPECT_EQ(out.changed, 1U);
}

TEST(Kepware, IsToldByItsHead) {
  EXPECT_TRUE(is_kepware(kHead));
  EXPECT_FALSE(is_kepware("a,b\n"));
  EXPECT_FALSE(import_kepware("a,b\n", {}));
  EXPECT_FALSE(import_kepware("", {}));
}

TEST(Kepware, SemicolonsAndFewColumns) {
  const Made out = made_of("Tag Name;Address\nT;400001\n", import_kepware, {"d", "", "", "h:502"});
  EXPECT_EQ(out.config["devices"][0]["tags"][0]["name"], "t");
}

TEST(Kepware, BitsAndStringsOfMitsubishi) {
  const Made out = made(
      "\"A\",\"D0700.05\",Boolean,1,RO,100,,,,,,,,,,\"\",\n"
      "\"B\",\"D0700.12\",Boolean,1,RO,100,,,,,,,,,,\"\",\n"
      "\"C\",\"DSH0100.020\",String,1,RO,100,,,,,,,,,,\"\",\n"
      "\"D\",\"DSL0120.008\",String,1,RO,100,,,,,,,,,,\"\",\n"
      "\"E\",\"D0200.10L\",String,1,RO,100,,,,,,,,,,\"\",\n"
      "\"F\",\"WSH01F.4\",String,1,RO,100,,,,,,,,,,\"\",\n"
      "\"G\",\"D0700.16\",Boolean,1,RO,100,,,,,,,,,,\"\",\n",
      {"plc", "mc-3e", "Q", "192.0.2.7:5000"});
  EXPECT_EQ(out.config["devices"][0]["tags"], json::parse(R"([
    {"name":"a","address":"D0700.5","type":"bool","group":"every_100_ms"},
    {"name":"b","address":"D0700.C","type":"bool","group":"every_100_ms"},
    {"name":"c","address":"D0100","type":"string","length":20,"word_order":"high_first","group":"every_100_ms"},
    {"name":"d","address":"D0120","type":"string","length":8,"word_order":"low_first","group":"every_100_ms"},
    {"name":"e","address":"D0200","type":"string","length":10,"word_order":"low_first","group":"every_100_ms"},
    {"name":"f","address":"W01F","type":"string","length":4,"word_order":"high_first","group":"every_100_ms"}
  ])"));
  expect_note(out, {"8: left out: \"g\""});
  EXPECT_EQ(out.left_out, 1U);
}

}  // namespace
}  // namespace fxagent
