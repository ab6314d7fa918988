// Addresses of the devices in the memory of the programming port. There are three maps: the classic
// commands, the extended ones of FX1N/FX2N and those of FX3S/FX3G/FX3U have one each.
// Sources: GX Developer captures on FX0N, FX1N and FX2N; GX Works2 captures on FX3G. The FX3 bases
// of S, X, T, C come from a published client and were never captured. See protocol/README.md.
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
  std::uint16_t address = 0;  ///< address of its first byte, as commands 0, 1, E00 and E10 count
  /// Bit address of its first device, as commands 7, 8, E7 and E8 count; nullopt for words.
  std::optional<std::uint16_t> force;
  std::uint32_t devices = 0;  ///< devices in the map, whatever the model has

  std::uint32_t bits() const { return devices * kind_of(space).bits; }
  std::uint32_t bytes() const { return bits() / 8; }
};

using PortMap = std::span<const PortArea>;

/// Returns the map of a command set on this model. The classic one is the same for all. The
/// extended one is empty if the model lacks it (FX0N, FX1S) or is unknown: the two extended maps
/// have different devices at the same address.
PortMap map_of(Model model, CommandSet set);

/// Return nullptr if the map has no such area.
const PortArea* area_of(PortMap map, Space space);
const PortArea* area_at_byte(PortMap map, std::uint32_t address);
const PortArea* area_at_bit(PortMap map, std::uint32_t address);

}  // namespace fxagent::fx
