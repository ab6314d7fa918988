#include "protocol/fx/port_map.h"

#include <gtest/gtest.h>

#include <map>

namespace fxagent::fx {
namespace {

const std::map<std::string, PortMap> kMaps = {
    {"classic", classic_map()}, {"FX1N/FX2N", extended_map_fx2n()}, {"FX3", extended_map_fx3()}};

TEST(PortMap, ForceAddressIsEightTimesTheByteAddressPlusTheBit) {
  for (const auto& [name, map] : kMaps) {
    for (const PortArea& area : map) {
      if (!area.force) continue;
      for (std::uint32_t n = 0; n < area.devices; ++n) {
        const std::uint32_t byte = area.address + n / 8;
        const std::uint32_t force = (*area.force + n) & 0xFFFF;
        ASSERT_EQ(force, (8 * byte + n % 8) & 0xFFFF)
            << name << " " << kind_of(area.space).letters << " " << n;
      }
    }
  }
}

TEST(PortMap, NoTwoAreasOfAMapShareAByteOrAForceAddress) {
  for (const auto& [name, map] : kMaps) {
    for (const PortArea& area : map) {
      EXPECT_EQ(area.bits() % 8, 0U);
      for (std::uint32_t byte = 0; byte < area.bytes(); ++byte)
        ASSERT_EQ(area_at_byte(map, area.address + byte), &area) << name << " " << byte;
      if (!area.force) continue;
      for (std::uint32_t bit = 0; bit < area.devices; ++bit)
        ASSERT_EQ(area_at_bit(map, *area.force + bit), &area) << name << " " << bit;
    }
  }
}

TEST(PortMap, EveryMapHasEverySpaceOnce) {
  for (const auto& [name, map] : kMaps) {
    EXPECT_EQ(map.size(), kSpaces - 1U) << name;
    EXPECT_EQ(area_of(map, Space::r), nullptr) << "no document knows where the R are";
    for (std::uint16_t i = 0; i < kSpaces; ++i) {
      const auto space = static_cast<Space>(i);
      if (space == Space::r) continue;
      const PortArea* area = area_of(map, space);
      ASSERT_NE(area, nullptr) << name << " " << i;
      EXPECT_EQ(area->force.has_value(), kind_of(space).bits == 1);
    }
  }
}

TEST(PortMap, TheExtendedMapsReachEveryDeviceOfTheirModels) {
  for (const Model model : {Model::fx1n, Model::fx2n, Model::fx3s, Model::fx3g, Model::fx3u}) {
    const PortMap map = map_of(model, CommandSet::extended);
    for (std::uint16_t i = 0; i < kSpaces; ++i) {
      const auto space = static_cast<Space>(i);
      if (space == Space::r) continue;
      for (const Numbers& run : numbers_of(model, space))
        EXPECT_LE(span_of(space, run).end_bit(), area_of(map, space)->bits())
            << to_string(model) << " " << kind_of(space).letters;
    }
  }
}

TEST(PortMap, AModelWithoutExtendedCommandsHasNoExtendedMap) {
  for (const Model model : {Model::fx0n, Model::fx1s, Model::unknown}) {
    EXPECT_TRUE(map_of(model, CommandSet::extended).empty());
    EXPECT_FALSE(map_of(model, CommandSet::classic).empty());
  }
  EXPECT_EQ(area_of({}, Space::d), nullptr);
  EXPECT_EQ(area_at_byte(classic_map(), 0x8000), nullptr);
  EXPECT_EQ(area_at_bit(classic_map(), 0xFFFF), nullptr);
}

}  // namespace
}  // namespace fxagent::fx
