// Device comments in the formats of GX Developer, GX Works2 and GX Works3.
#include <gtest/gtest.h>

#include "tests/agent/import/outcome.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using namespace test;

Made gx(std::string_view text) { return made_of(text, import_gx_comments); }

TEST(GxComments, GxDeveloperHasCommasAndLabels) {
  const Made made = made_of(
      "Device,Label,Comment\r\n"
      "X0,START,Start button\r\n"
      "X1,STOPB,\r\n"
      "D100,,\"Oil temperature, tank 1\"\r\n",
      import_gx_comments, {"press1", "fx-programming-port", "FX3U", "/dev/ttyUSB3"});
  ASSERT_EQ(made.config["devices"].size(), 1U) << all_of(made.notes);
  const auto& device = made.config["devices"][0];
  EXPECT_EQ(device["name"], "press1");
  EXPECT_EQ(device["model"], "FX3U");
  EXPECT_EQ(device["protocol"], "fx-programming-port");
  EXPECT_EQ(made.config["links"][0]["serial"]["path"], "/dev/ttyUSB3");
  EXPECT_EQ(device["tags"].dump(),
            R"([{"address":"X0","description":"Start button","name":"start_button"},)"
            R"({"address":"X1","description":"STOPB","name":"stopb"},)"
            R"({"address":"D100","description":"Oil temperature, tank 1",)"
            R"("name":"oil_temperature_tank_1"}])");
  EXPECT_TRUE(made.notes.empty()) << all_of(made.notes);
}

TEST(GxComments, GxWorks2HasTabsAndATitle) {
  const Made made =
      gx("\"Press line\"\r\n\"COMMENT\"\r\n\"Device Name\"\t\"Comment\"\r\n"
         "\"M0\"\t\"running\"\r\n\"M1\"\t\"\"\r\n\"TN5\"\t\"fill time\"\r\n");
  EXPECT_EQ(made.config["devices"][0]["tags"].size(), 2U);
  expect_note(made, {"0: left out: 1 device without a comment"});
  expect_note(made, {"the link is a placeholder, /dev/ttyUSB0: set the real one, as with --port"});
  expect_note(made, {"plc1: the protocol is assumed to be fx-programming-port", "--protocol"});
}

TEST(GxComments, GxWorks3HasAColumnForEachLanguage) {
  const Made made =
      gx("\"Device Name\"\t\"Japanese/日本語\"\t\"English(Display Target)\"\r\n"
         "\"D0\"\t\"\"\t\"speed\"\r\n\"D1\"\t\"圧力\"\t\"pressure\"\r\n");
  EXPECT_EQ(made.config["devices"][0]["tags"][0]["name"], "speed");
  EXPECT_EQ(made.config["devices"][0]["tags"][1]["name"], "d1");
  EXPECT_EQ(made.config["devices"][0]["tags"][1].value("description", ""), "圧力");
  expect_note(made, {"3: ", "圧力", "is named d1"});
}

TEST(GxComments, CommasInQuotedCommentsAreNoDelimiters) {
  std::string text = "\"Device Name\"\t\"Comment\"\r\n";
  for (int i = 0; i < 20; ++i)
    text += "\"D" + std::to_string(i) + "\"\t\"pump, valve, tank " + std::to_string(i) + "\"\r\n";
  EXPECT_TRUE(is_gx_comments(text));
  const Made made = gx(text);
  EXPECT_EQ(made.config["devices"][0]["tags"].size(), 20U);
  EXPECT_EQ(made.config["devices"][0]["tags"][3]["name"], "pump_valve_tank_3");
}

TEST(GxComments, ShiftJisHead) {
  // デバイス名,コメント / D5,温度
  const std::string bytes =
      "\x83\x66\x83\x6F\x83\x43\x83\x58\x96\xBC,\x83\x52\x83\x81\x83\x93\x83\x67\r\n"
      "D5,\x89\xB7\x93\x78\r\n";
  const auto text = to_utf8(bytes, "CP932");
  ASSERT_TRUE(text);
  EXPECT_TRUE(is_gx_comments(*text));
  const Made made = gx(*text);
  EXPECT_EQ(made.config["devices"][0]["tags"][0]["address"], "D5");
  expect_note(made, {"2: ", "温度"});
}

TEST(GxComments, DevicesThatAConfigLacksAreNamedWithTheirLine) {
  const Made made = gx("Device Name,Comment\nP10,subroutine\nX8,wrong\nD0,right\n???,x\n");
  EXPECT_EQ(made.config["devices"][0]["tags"].size(), 1U);
  expect_note(made, {"2: left out", "P10"});
  expect_note(made, {"3: left out", "X8"});
  expect_note(made, {"5: left out", "???", "is not a device"});
}

TEST(GxComments, AFileWithoutAHeadHasDevicesAtLeast) {
  EXPECT_EQ(gx("D0,speed\n").config["devices"][0]["tags"].size(), 1U);
  EXPECT_EQ(error_of(import_gx_comments("a,b\nc,d\n", {})).text, "has no device comments");
}

}  // namespace
}  // namespace fxagent
