#include "protocol/fx/port_map.h"

#include <algorithm>
#include <array>

namespace fxagent::fx {
namespace {

constexpr std::optional<std::uint16_t> kNoForce = std::nullopt;

// Each map has every space of an FX except R, whose addresses are not documented.
constexpr std::size_t kMapped = 14;

constexpr std::array<PortArea, kMapped> kClassic = {{
    {Space::s, 0x0000, 0x0000, 1024},
    {Space::x, 0x0080, 0x0400, 256},
    {Space::y, 0x00A0, 0x0500, 256},
    {Space::ts, 0x00C0, 0x0600, 256},
    {Space::m, 0x0100, 0x0800, 1536},
    {Space::cs, 0x01C0, 0x0E00, 256},
    {Space::special_m, 0x01E0, 0x0F00, 256},
    {Space::tc, 0x02C0, 0x1600, 256},
    {Space::cc, 0x03C0, 0x1E00, 256},
    {Space::tn, 0x0800, kNoForce, 256},
    {Space::cn, 0x0A00, kNoForce, 200},
    {Space::cn32, 0x0C00, kNoForce, 56},
    {Space::special_d, 0x0E00, kNoForce, 256},
    {Space::d, 0x1000, kNoForce, 1024},
}};

constexpr std::array<PortArea, kMapped> kExtendedFx2n = {{
    {Space::m, 0x0000, 0x0000, 3072},
    {Space::y, 0x0180, 0x0C00, 256},
    {Space::special_m, 0x01C0, 0x0E00, 256},
    {Space::cs, 0x01E0, 0x0F00, 256},
    {Space::ts, 0x0200, 0x1000, 256},
    {Space::x, 0x0240, 0x1200, 256},
    {Space::s, 0x0280, 0x1400, 1024},
    {Space::cc, 0x04E0, 0x2700, 256},
    {Space::tc, 0x0500, 0x2800, 256},
    {Space::cn, 0x0A00, kNoForce, 200},
    {Space::cn32, 0x0C00, kNoForce, 56},
    {Space::special_d, 0x0E00, kNoForce, 256},
    {Space::tn, 0x1000, kNoForce, 256},
    {Space::d, 0x4000, kNoForce, 8000},
}};

constexpr std::array<PortArea, kMapped> kExtendedFx3 = {{
    {Space::cn, 0x0A00, kNoForce, 200},
    {Space::cn32, 0x0C00, kNoForce, 56},
    {Space::tn, 0x1000, kNoForce, 512},
    {Space::d, 0x4000, kNoForce, 8000},
    {Space::special_d, 0x8000, kNoForce, 512},
    {Space::m, 0x8800, 0x4000, 7680},
    {Space::y, 0x8BC0, 0x5E00, 256},
    {Space::special_m, 0x8C00, 0x6000, 512},
    {Space::x, 0x8CA0, 0x6500, 256},
    {Space::s, 0x8CE0, 0x6700, 4096},
    {Space::cc, 0x92E0, 0x9700, 256},
    {Space::tc, 0x9300, 0x9800, 512},
    {Space::cs, 0x9340, 0x9A00, 256},
    {Space::ts, 0x9360, 0x9B00, 512},
}};

template <class Match>
const PortArea* find(PortMap map, Match match) {
  const auto found = std::find_if(map.begin(), map.end(), match);
  return found == map.end() ? nullptr : &*found;
}

}  // namespace

PortMap map_of(Model model, CommandSet set) {
  if (set == CommandSet::classic) return kClassic;
  switch (model) {
    case Model::fx1n:
    case Model::fx2n:
      return kExtendedFx2n;
    case Model::fx3s:
    case Model::fx3g:
    case Model::fx3u:
      return kExtendedFx3;
    default:
      return {};
  }
}

const PortArea* area_of(PortMap map, Space space) {
  return find(map, [&](const PortArea& area) { return area.space == space; });
}

const PortArea* area_at_byte(PortMap map, std::uint32_t address) {
  return find(map, [&](const PortArea& area) {
    return area.address <= address && address - area.address < area.bytes();
  });
}

const PortArea* area_at_bit(PortMap map, std::uint32_t address) {
  return find(map, [&](const PortArea& area) {
    return area.force && *area.force <= address && address - *area.force < area.devices;
  });
}

}  // namespace fxagent::fx
