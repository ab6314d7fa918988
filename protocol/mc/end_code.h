// End codes of 3E, 4E, 3C and 4C: their text, with the setting to check, and their meaning for the
// next polls and commands of the device.
// Sources: SH-080008, JY997D56001, QnUCPU and LCPU built-in Ethernet manuals, QJ71C24 manuals.
// protocol/README.md lists the codes that PLCs were observed to send.
#pragma once

#include <cstdint>
#include <string>

#include "protocol/codec.h"
#include "protocol/mc/device.h"

namespace fxagent::mc {

/// Returns "end code C056: beyond the last device". If a setting helps, the text names it as the
/// tool of that series does.
std::string end_code_text(std::uint16_t code, Series series);

/// Returns the meaning for a read or for any other request. `runs_or_stops`: such a request is
/// never sent twice, whatever the reason.
RefusalMeaning meaning_of_end_code(std::uint16_t code, bool reads, bool runs_or_stops);

/// True if the PLC refuses every request with this code, because of a password or a setting of its
/// port.
bool refuses_everything(std::uint16_t code);

/// True if the PLC lacks the command or its subcommand.
bool is_unknown_command(std::uint16_t code);

}  // namespace fxagent::mc
