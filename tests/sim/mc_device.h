// Device names of the MC protocol in 3E, 4E, 3C and 4C, and its view of a PLC's memory: points,
// words of 16 points and double words.
// Source: MELSEC Communication Protocol Reference Manual SH-080008; FX5 User's Manual (SLMP).
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "tests/sim/memory.h"
#include "tests/sim/plc.h"

namespace fxsim {

/// Returns the device kind of a device code in `family`, or nullopt if the family does not have it.
std::optional<Kind> mc_kind_of_code(std::uint32_t code, Family family);
/// The same for the letters of the ASCII code: "D*", "SB", "TS", or with `long_names` (iQ-R)
/// "D***", "STN*".
std::optional<Kind> mc_kind_of_letters(std::string_view letters, bool long_names, Family family);
/// The base of the number that follows the letters.
unsigned mc_base_of(Kind kind);

bool is_bit(Kind kind);
/// True if the `count` devices of the row starting at `first` all exist.
bool has_row(const DeviceMemory& memory, Device first, std::uint64_t count);

/// Returns 16 points starting at a bit device, the first in the lowest bit, or a word device.
std::uint32_t word_at(const DeviceMemory& memory, Device head);
void set_word_at(Plc& plc, Device head, std::uint32_t value);
/// Returns 32 points, two word devices (low word first) or one 32-bit device.
std::uint32_t double_at(const DeviceMemory& memory, Device head);
void set_double_at(Plc& plc, Device head, std::uint32_t value);

}  // namespace fxsim
