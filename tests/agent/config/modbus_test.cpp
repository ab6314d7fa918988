// The config's findings about Modbus devices: addresses, byte orders, units, links.
#include <gtest/gtest.h>

#include "protocol/modbus/pdu.h"
#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;
using modbus::id;
using modbus::Space;
using nlohmann::json;

/// Two RTU units on the serial line of the small plant, a TCP device behind its other link.
json modbus_plant() {
  json plant = small_plant();
  plant["devices"] = json::parse(R"([
    {"name": "oven", "link": "line1", "protocol": "modbus-rtu", "unit": 3,
     "tags": [
       {"name": "temp", "address": "ir:0"},
       {"name": "total", "address": "hr:10", "type": "uint32"}
     ],
     "commands": {"allow": ["co:0-co:7", "hr:100-119"]}},
    {"name": "drive", "link": "line1", "protocol": "modbus-rtu", "unit": 4},
    {"name": "meter", "link": "gw1", "protocol": "modbus-tcp"}
  ])");
  return plant;
}

json plant_with(const std::string& pointer, const std::string& value) {
  json plant = modbus_plant();
  plant[json::json_pointer(pointer)] = json::parse(value);
  return plant;
}

Config good_with(const std::string& pointer, const std::string& value) {
  return good(plant_with(pointer, value).dump());
}

void expect_modbus_error(const std::string& pointer, const std::string& value,
                         const std::string& place, const std::vector<std::string>& words) {
  SCOPED_TRACE(pointer + " = " + value);
  expect_error(plant_with(pointer, value).dump(1), place, words);
}
void expect_modbus_refused(const std::string& pointer, const std::string& value,
                           const std::vector<std::string>& words) {
  expect_modbus_error(pointer, value, pointer, words);
}

TEST(ConfigModbus, UnitsShareALineWithoutAWarning) {
  const Config config = good(modbus_plant().dump());
  ASSERT_EQ(config.devices.size(), 3U);
  EXPECT_TRUE(config.warnings.empty()) << config.warnings.front();
  EXPECT_EQ(config.devices[0].link, config.devices[1].link);
  const auto unit_of = [](const DeviceConfig& device) {
    return (*device.codec->encode(Read{{id(Space::coil), 0, 1}}, 0))[0];
  };
  EXPECT_EQ(unit_of(config.devices[0]), 3);
  EXPECT_EQ(unit_of(config.devices[1]), 4);
}

TEST(ConfigModbus, ValueThatIsLongerThanTheLongestReadIsWarnedOf) {
  EXPECT_TRUE(good_with("/devices/0/max_read", "2").warnings.empty());
  for (const auto& [key, least] : {std::pair{"max_read", "1"}, {"max_block_bytes", "2"}}) {
    const Config config = good_with(std::string("/devices/0/") + key, least);
    ASSERT_EQ(config.warnings.size(), 1U) << key;
    EXPECT_NE(config.warnings[0].find("takes several reads"), std::string::npos)
        << config.warnings[0];
  }
}

TEST(ConfigModbus, LineSettingsAreThoseOfTheSpecification) {
  const auto settings = [](const json& plant) {
    return std::get<SerialSettings>(good(plant.dump()).links.at(0).channel);
  };
  EXPECT_EQ(settings(modbus_plant()).data_bits, 8);
  EXPECT_EQ(settings(modbus_plant()).parity, Parity::even);
  json plant = modbus_plant();
  plant["devices"][0]["protocol"] = "modbus-ascii";
  plant["devices"][1]["protocol"] = "modbus-ascii";
  EXPECT_EQ(settings(plant).data_bits, 7);
}

TEST(ConfigModbus, AddressesAreTablesAndNumbers) {
  const struct {
    const char* address;
    const char* canonical;
    DataType type;
  } cases[] = {{"hr:100", "hr:100", DataType::int16},    {"40101", "hr:100", DataType::int16},
               {"400101", "hr:100", DataType::int16},    {"ir:0x10", "ir:16", DataType::int16},
               {"co:5", "co:5", DataType::boolean},      {"di:7", "di:7", DataType::boolean},
               {"00001", "co:0", DataType::boolean},     {"10001", "di:0", DataType::boolean},
               {"hr:1.15", "hr:1.15", DataType::boolean}};
  for (const auto& c : cases) {
    const Config config =
        good_with("/devices/0/tags/0/address", "\"" + std::string(c.address) + "\"");
    ASSERT_EQ(config.devices.size(), 3U) << c.address;
    EXPECT_EQ(config.devices[0].tags[0].point.address.text, c.canonical);
    EXPECT_EQ(config.devices[0].tags[0].point.type, c.type) << c.address;
  }
}

TEST(ConfigModbus, WrongAddressesNameTheFormsAndTheRange) {
  const std::string place = "/devices/0/tags/0/address";
  expect_modbus_refused(place, R"("D100")", {"hr:0 ir:0 co:0 di:0", "40001"});
  expect_modbus_refused(place, R"("hr:65536")", {"0 to 65535"});
  expect_modbus_refused(place, R"("40000")", {"40001 to 49999", "hr:40000"});
  expect_modbus_refused(place, R"("465537")", {"400001 to 465536"});
  expect_modbus_refused(place, R"("4001")", {"5 or 6 digits"});
  expect_modbus_refused(place, R"("hr:1.16")", {".0 to .15"});
  expect_modbus_refused(place, R"("co:1.0")", {"only registers have bits"});
  expect_modbus_error("/devices/0/tags/0", R"({"name": "t", "address": "hr:65535", "count": 2})",
                      place, {"ends at hr:65535"});
}

TEST(ConfigModbus, TheAddressBaseMovesNamesWithATableAndNoOthers) {
  json plant = plant_with("/devices/0/address_base", "1");
  plant["devices"][0]["tags"] =
      json::parse(R"([{"name": "a", "address": "hr:100"}, {"name": "b", "address": "40100"}])");
  plant["devices"][0]["commands"]["allow"][0] = "co:1-co:8";
  const Config config = good(plant.dump());
  ASSERT_EQ(config.devices.size(), 3U);
  const auto& tags = config.devices[0].tags;
  EXPECT_EQ(tags[0].point.address.span, tags[1].point.address.span);
  EXPECT_EQ(tags[0].point.address.span.first_bit, 99U * 16);
  EXPECT_EQ(tags[1].point.address.text, "hr:100");
  plant["devices"][0]["tags"][0]["address"] = "hr:0";
  expect_error(plant.dump(1), "/devices/0/tags/0/address", {"1 to 65536"});
}

TEST(ConfigModbus, TheDevicesByteOrderIsThatOfItsTags) {
  const auto order = [](const Config& config) {
    return config.devices.at(0).tags.at(1).point.order;
  };
  EXPECT_EQ(order(good(modbus_plant().dump())), ByteOrder::abcd);
  EXPECT_EQ(order(good_with("/devices/0/byte_order", R"("BADC")")), ByteOrder::badc);
  for (const auto& [word, wanted] :
       std::vector<std::pair<const char*, ByteOrder>>{{"ABCD", ByteOrder::abcd},
                                                      {"CDAB", ByteOrder::cdab},
                                                      {"BADC", ByteOrder::badc},
                                                      {"DCBA", ByteOrder::dcba},
                                                      {"low_first", ByteOrder::cdab},
                                                      {"high_first", ByteOrder::abcd}}) {
    json plant = plant_with("/devices/0/byte_order", R"("DCBA")");
    plant["devices"][0]["tags"][1]["word_order"] = word;
    EXPECT_EQ(order(good(plant.dump())), wanted) << word;
  }
  expect_modbus_refused("/devices/0/byte_order", R"("little")", {"ABCD"});
}

TEST(ConfigModbus, OnlyCoilsHoldingRegistersAndTheirBitsAreWritten) {
  const auto tag = [](const std::string& address) {
    return R"({"name": "t", "address": ")" + address + R"(", "access": "read_write"})";
  };
  for (const auto* address : {"co:0", "hr:0", "hr:0.3"}) {
    const Config config = good_with("/devices/0/tags/0", tag(address));
    ASSERT_FALSE(config.devices.empty()) << address;
    EXPECT_TRUE(config.devices[0].tags[0].writable) << address;
  }
  for (const auto* address : {"di:0", "ir:0", "ir:0.3"})
    expect_modbus_error("/devices/0/tags/0", tag(address), "/devices/0/tags/0/access",
                        {address, "only be read"});
}

TEST(ConfigModbus, AllowTakesRangesOfOneTable) {
  const Config config = good(modbus_plant().dump());
  EXPECT_EQ(config.devices[0].commands.allow,
            (std::vector<Span>{{id(Space::coil), 0, 8}, {id(Space::holding_register), 1600, 320}}));
  const std::string place = "/devices/0/commands/allow/0";
  expect_modbus_refused(place, R"("co:0-hr:7")", {"one table"});
  expect_modbus_refused(place, R"("hr:9-hr:5")", {"ends before"});
  expect_modbus_refused(place, R"("hr:1-40119")", {"write hr:40119"});
}

TEST(ConfigModbus, ABroadcastHasNoTagsAndMayHaveCommands) {
  expect_modbus_error("/devices/0/unit", "0", "/devices/0/tags",
                      {"broadcast", "cannot have tags", "commands/allow"});
  json plant = plant_with("/devices/0/unit", "0");
  plant["devices"][0].erase("tags");
  const Config config = good(plant.dump());
  ASSERT_FALSE(config.devices.empty());
  EXPECT_TRUE(config.devices[0].codec->is_broadcast());
  EXPECT_EQ(config.devices[0].commands.allow.size(), 2U);
  json tcp = modbus_plant();
  tcp["devices"][2]["unit"] = 0;
  tcp["devices"][2]["tags"] = json::parse(R"([{"name": "t", "address": "hr:0"}])");
  EXPECT_FALSE(good(tcp.dump()).devices[2].codec->is_broadcast());
}

TEST(ConfigModbus, ReservedUnitsAreForTcpOnly) {
  expect_modbus_refused("/devices/0/unit", "248", {"1 to 247"});
  good_with("/devices/2/unit", "255");
  expect_modbus_refused("/devices/2/unit", "256", {"0 to 255"});
}

TEST(ConfigModbus, OneLinkSpeaksOneProtocol) {
  expect_modbus_refused("/devices/1/protocol", R"("modbus-ascii")",
                        {"one protocol", "/devices/0 (line", "modbus-rtu", "another link"});
  json plant = modbus_plant();
  plant["devices"] = json::array({plant["devices"][2]});
  plant["devices"][0]["link"] = "line1";
  expect_error(plant.dump(1), "/devices/0/link",
               {"modbus-tcp", "serial", "needs one with \"tcp\""});
  plant = modbus_plant();
  plant["devices"][2]["protocol"] = "modbus-rtu";  // through a transparent serial server
  good(plant.dump());
}

TEST(ConfigModbus, ThereIsNoModelAndNoRunAndStop) {
  expect_modbus_refused("/devices/2/model", R"("FX3U")",
                        {"modbus-tcp has no models", "leave", "auto"});
  good_with("/devices/2/model", R"("auto")");
  const Config config = good_with("/devices/2/commands", R"({"allow_run_stop": true})");
  EXPECT_TRUE(warns(config, {"allow_run_stop", "no run and stop"}));
}

TEST(ConfigModbus, KeysOfOtherProtocolsNameThemAndTheirOwnInTheirPlace) {
  expect_modbus_refused("/devices/0/station", "1",
                        {"is for fx-computer-link", "modbus-rtu may have unit, "});
  expect_modbus_refused("/devices/2/enquire", R"("never")",
                        {"is for fx-programming-port; ", "modbus-tcp may have unit, "});
  json plant = modbus_plant();
  plant["devices"][0].erase("tags");
  plant["devices"][0].erase("commands");
  plant["devices"][0]["protocol"] = "fx-computer-link";
  plant["devices"][0]["link"] = "gw1";
  plant["devices"].erase(2);
  expect_error(
      plant.dump(1), "/devices/0/unit",
      {"is for modbus-rtu, modbus-ascii or modbus-tcp; ", "fx-computer-link may have station, "});
  expect_modbus_refused("/devices/0/max_reed", "1", {"unknown key", "did you mean max_read?"});
}

TEST(ConfigModbus, RtuNeedsTheEighthBit) {
  const std::string seven = R"({"path": "/dev/ttyUSB0", "data_bits": 7})";
  expect_modbus_error("/links/0/serial", seven, "/links/0/serial/data_bits",
                      {"modbus-rtu needs 8 data bits"});
  json plant = plant_with("/links/0/serial", seven);
  plant["devices"][0]["protocol"] = "modbus-ascii";
  plant["devices"][1]["protocol"] = "modbus-ascii";
  good(plant.dump());
  plant["links"][0]["serial"]["data_bits"] = 8;
  good(plant.dump());
  plant = modbus_plant();
  plant["devices"][2]["protocol"] = "modbus-rtu";
  plant["links"][1]["data_bits"] = 7;
  expect_error(plant.dump(1), "/links/1/data_bits", {"modbus-rtu needs 8 data bits"});
}

}  // namespace
}  // namespace fxagent
