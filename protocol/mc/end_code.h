// What a PLC means by the end code of 3E, 4E, 3C and 4C: in words, with the setting to look at, and
// for the device's next polls and commands.
// Sources: SH-080008, JY997D56001, QnUCPU and LCPU built-in Ethernet manuals, QJ71C24 manuals;
// protocol/README.md says which codes PLCs were seen to give.
#pragma once

#include <cstdint>
#include <string>

#include "protocol/codec.h"
#include "protocol/mc/device.h"

namespace fxagent::mc {

/// "end code C056: beyond the last device". Where a setting helps it is named as the tool of that
/// series has it.
std::string end_code_text(std::uint16_t code, Series series);

/// What it means for a read or for something else. `runs_or_stops`: such a request is never sent
/// twice, whatever the reason.
RefusalMeaning meaning_of_end_code(std::uint16_t code, bool reads, bool runs_or_stops);

/// Whether the PLC refuses whatever is asked with it, by a password or a setting of its port.
bool refuses_everything(std::uint16_t code);

/// Whether the PLC lacks the command or its subcommand.
bool is_unknown_command(std::uint16_t code);

}  // namespace fxagent::mc
