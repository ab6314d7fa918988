// The config's findings about MC devices: lines without enough data bits, pauses on UDP.
#include <gtest/gtest.h>

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

TEST(ConfigMc, OnUdpARestLiesBehindAnswersWithoutNumbers) {
  const auto gap = [](const std::string& channel, const std::string& protocol,
                      std::optional<int> given = std::nullopt) {
    json plant = small_plant();
    plant["links"] = json::array({{{"name", "eth1"}}});
    plant["links"][0][channel] = json::parse(R"({"host": "192.0.2.20", "port": 5007})");
    plant["devices"] = json::array({{{"name", "press"}, {"link", "eth1"}, {"protocol", protocol}}});
    if (given) plant["devices"][0]["gap_ms"] = *given;
    return good(plant.dump(1)).devices[0].gap.count();
  };
  EXPECT_EQ(gap("udp", "mc-3e"), 10);
  EXPECT_EQ(gap("udp", "mc-1e"), 10);
  EXPECT_EQ(gap("udp", "mc-4e"), 0) << "its answers have numbers";
  EXPECT_EQ(gap("tcp", "mc-3e"), 0);
  EXPECT_EQ(gap("udp", "mc-3e", 5), 10);
  EXPECT_EQ(gap("udp", "mc-3e", 25), 25);
}

}  // namespace
}  // namespace fxagent
