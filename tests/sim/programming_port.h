// The Mitsubishi FX programming port, PLC side: ENQ, 0, 1, 7, 8, E00, E10, E7 and E8.
// No Mitsubishi manual describes it. The frames and address maps are those on which captures of GX
// Developer and GX Works2 and several independent clients agree. Frames are ASCII between STX and
// ETX, followed by the low byte of the sum of everything after STX up to and including ETX, as two
// hex digits.
// A PLC may be more lenient or stricter in undocumented cases; this one refuses everything that the
// maps do not name.
#pragma once

#include "tests/sim/personality.h"

namespace fxsim {

std::unique_ptr<Personality> make_programming_port();

/// The address map of a set of commands.
enum class CommandSet : std::uint8_t { classic, fx1n_fx2n, fx3 };

struct ByteAt {
  Kind kind;
  std::size_t offset;  // in the kind's row
};
/// Returns the byte that a read or write of `address` accesses on a PLC that has every device.
std::optional<ByteAt> byte_at(CommandSet set, std::uint32_t address);
/// Returns the bit that a force of `address` sets on a PLC that has every device.
std::optional<Device> bit_at(CommandSet set, std::uint32_t address);

}  // namespace fxsim
