// Where each device lives in the memory that the programming port addresses: three maps, since the
// classic commands, the extended ones of FX1N/FX2N and those of FX3S/FX3G/FX3U each have their own.
// Sources: GX Developer captures on FX0N, FX1N and FX2N; GX Works2 captures on FX3G; the FX3 bases
// of S, X, T, C were never seen on a wire and come from a published client. See protocol/README.md.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "protocol/fx/device.h"

namespace fxagent::fx {

enum class CommandSet : std::uint8_t { classic, extended };

/// One run of devices in a map.
struct PortArea {
  Space space = Space::d;
  std::uint16_t address = 0;  ///< of its first byte, as commands 0, 1, E00 and E10 count
  /// Bit address of its first device, as commands 7, 8, E7 and E8 count; nullopt for words.
  std::optional<std::uint16_t> force;
  std::uint32_t devices = 0;  ///< how many the map holds, whatever the model has

  std::uint32_t bits() const { return devices * kind_of(space).bits; }
  std::uint32_t bytes() const { return bits() / 8; }
};

using PortMap = std::span<const PortArea>;

PortMap classic_map();
PortMap extended_map_fx2n();  ///< FX1N, FX2N
PortMap extended_map_fx3();   ///< FX3S, FX3G, FX3U

/// The map of a command set on this model; empty where the model lacks the set (FX0N, FX1S) or is
/// unknown, since the two extended maps put different devices at one address.
PortMap map_of(Model model, CommandSet set);

/// nullptr where the map has none.
const PortArea* area_of(PortMap map, Space space);
const PortArea* area_at_byte(PortMap map, std::uint32_t address);
const PortArea* area_at_bit(PortMap map, std::uint32_t address);

}  // namespace fxagent::fx
