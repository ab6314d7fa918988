// What the config says about MC devices on serial lines.
#include <gtest/gtest.h>

#include <string>

#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;

/// Two stations on the serial line of the small plant, the second one in `format`.
json mc_plant(int format, const std::string& line) {
  json plant = small_plant();
  plant["links"][0]["serial"] = json::parse(R"({"path": "/dev/ttyUSB0")" + line + "}");
  plant["devices"] = json::parse(R"([
    {"name": "oven", "link": "line1", "protocol": "mc-4c", "model": "Q"},
    {"name": "press", "link": "line1", "protocol": "mc-4c", "model": "Q", "station": 1}
  ])");
  plant["devices"][1]["format"] = format;
  return plant;
}

TEST(ConfigMc, BinaryFramesNeedTheEighthBit) {
  const std::string seven = R"(, "data_bits": 7)";
  expect_error(mc_plant(5, seven).dump(1), "/links/0/serial/data_bits",
               {"\"format\" 5 of press is binary and needs 8 data bits",
                "set 8 here and in the PLC, or \"format\" below 5"});
  good(mc_plant(4, seven).dump());
  EXPECT_EQ(std::get<SerialSettings>(good(mc_plant(5, "").dump()).links[0].channel).data_bits, 8);
  good(mc_plant(5, R"(, "data_bits": 8)").dump());
}

TEST(ConfigMc, BinaryFramesNeedTheEighthBitBehindASerialServerToo) {
  json plant = mc_plant(5, "");
  plant["links"][1]["data_bits"] = 7;
  for (json& device : plant["devices"]) device["link"] = "gw1";
  expect_error(plant.dump(1), "/links/1/data_bits",
               {"\"format\" 5 of press is binary and needs 8 data bits"});
}

}  // namespace
}  // namespace fxagent
