#include "protocol/fx/port_map.h"

#include <gtest/gtest.h>

namespace fxagent::fx {
namespace {

const std::map<std::string, PortMap> kMaps = {
    {"classic", map_of(Model::unknown_fx, CommandSet::classic)},
    {"FX1N/FX2N", map_of(Model::fx2n, CommandSet::extended)},
    {"FX3", map_of(Model::fx3u, CommandSet::extended)}};

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
    EXPECT_EQ(area_of(map, Space::r), nullptr) << "no document knows where the R are";
    std::size_t spaces = 0;
    for (std::uint16_t i = 0; i < kSpaces; ++i) {
      const auto space = static_cast<Space>(i);
      if (space == Space::r || numbers_of(Model::fx3u, space).empty()) continue;
      ++spaces;
      const PortArea* area = area_of(map, space);
      ASSERT_NE(area, nullptr) << name << " " << i;
      EXPECT_EQ(area->force.has_value(), kind_of(space).bits == 1);
    }
    EXPECT_EQ(map.size(), spaces) << name;
  }
}

/// The first byte of each area. Some areas have the same address in both extended maps.
TEST(PortMap, EachModelHasTheMapOfItsSeries) {
  const auto byte_of = [](Model model, CommandSet set, Space space) {
    const PortArea* area = area_of(map_of(model, set), space);
    return area == nullptr ? -1 : int{area->address};
  };
  for (const Model model : {Model::fx1n, Model::fx2n}) {
    EXPECT_EQ(byte_of(model, CommandSet::extended, Space::m), 0x0000) << to_string(model);
    EXPECT_EQ(byte_of(model, CommandSet::extended, Space::special_d), 0x0E00) << to_string(model);
  }
  for (const Model model : {Model::fx3s, Model::fx3g, Model::fx3u}) {
    EXPECT_EQ(byte_of(model, CommandSet::extended, Space::m), 0x8800) << to_string(model);
    EXPECT_EQ(byte_of(model, CommandSet::extended, Space::special_d), 0x8000) << to_string(model);
  }
  for (const Model model : {Model::fx0n, Model::fx1s, Model::fx1n, Model::fx3u, Model::unknown_fx})
    EXPECT_EQ(byte_of(model, CommandSet::classic, Space::m), 0x0100) << to_string(model);
  struct Bytes {
    Space space;
    int classic, fx2n, fx3;
  };
  for (const Bytes& bytes : {Bytes{Space::s, 0x0000, 0x0280, 0x8CE0},
                             {Space::x, 0x0080, 0x0240, 0x8CA0},
                             {Space::y, 0x00A0, 0x0180, 0x8BC0},
                             {Space::ts, 0x00C0, 0x0200, 0x9360},
                             {Space::cs, 0x01C0, 0x01E0, 0x9340},
                             {Space::special_m, 0x01E0, 0x01C0, 0x8C00},
                             {Space::tc, 0x02C0, 0x0500, 0x9300},
                             {Space::cc, 0x03C0, 0x04E0, 0x92E0},
                             {Space::tn, 0x0800, 0x1000, 0x1000},
                             {Space::cn, 0x0A00, 0x0A00, 0x0A00},
                             {Space::cn32, 0x0C00, 0x0C00, 0x0C00},
                             {Space::d, 0x1000, 0x4000, 0x4000}}) {
    EXPECT_EQ(byte_of(Model::fx3u, CommandSet::classic, bytes.space), bytes.classic);
    EXPECT_EQ(byte_of(Model::fx2n, CommandSet::extended, bytes.space), bytes.fx2n);
    EXPECT_EQ(byte_of(Model::fx3u, CommandSet::extended, bytes.space), bytes.fx3);
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
  for (const Model model : {Model::fx0n, Model::fx1s, Model::unknown_fx}) {
    EXPECT_TRUE(map_of(model, CommandSet::extended).empty());
    EXPECT_FALSE(map_of(model, CommandSet::classic).empty());
  }
  EXPECT_EQ(area_of({}, Space::d), nullptr);
  EXPECT_EQ(area_at_byte(kMaps.at("classic"), 0x8000), nullptr);
  EXPECT_EQ(area_at_bit(kMaps.at("classic"), 0xFFFF), nullptr);
}

}  // namespace
}  // namespace fxagent::fx
