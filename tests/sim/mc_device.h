// How the MC protocol names devices in 3E, 4E, 3C and 4C, and how a PLC's memory looks through it:
// in points, in words of 16 points and in double words.
// Source: MELSEC Communication Protocol Reference Manual SH-080008; FX5 User's Manual (SLMP).
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "tests/sim/memory.h"
#include "tests/sim/plc.h"

namespace fxsim {

/// What a device code means to a family; nothing where the code is unknown to it.
std::optional<Kind> mc_kind_of_code(std::uint32_t code, Family family);
/// The same for the letters of the ASCII code: "D*", "SB", "TS", or with `long_names` (iQ-R)
/// "D***", "STN*".
std::optional<Kind> mc_kind_of_letters(std::string_view letters, bool long_names, Family family);
/// The base of the digits that follow the letters.
unsigned mc_base_of(Kind kind);

bool is_bit(Kind kind);
/// Are there `count` devices of one row from `first` on?
bool has_row(const DeviceMemory& memory, Device first, std::uint64_t count);

/// 16 points from a bit device on, the first in the lowest bit, or a word device.
std::uint32_t word_at(const DeviceMemory& memory, Device head);
void set_word_at(Plc& plc, Device head, std::uint32_t value);
/// 32 points, two word devices with the low word first, or one device of 32 bits.
std::uint32_t double_at(const DeviceMemory& memory, Device head);
void set_double_at(Plc& plc, Device head, std::uint32_t value);

}  // namespace fxsim
