// Two-wire RS-485: the kernel enables the transmitter by the RTS line while the port sends, and
// disables it after the last bit, sooner than any program could. Source: Linux
// Documentation/driver-api/serial/serial-rs485.rst.
#pragma once

#include <string>

#include "agent/config/model.h"

struct serial_rs485;

namespace fxagent {

/// Makes the driver of an open port switch the direction. Returns an empty text, or what the port
/// cannot do and what to do about it; the text follows the port's path.
std::string switch_direction(int fd, const Rs485& wish);

/// Converts `wish` to the kernel's structure.
serial_rs485 kernel_settings(const Rs485& wish);

/// Returns the setting of `asked` that the driver did not accept, judged by what it `got`; empty:
/// none. A driver may change a setting without an error.
std::string not_taken(const serial_rs485& asked, const serial_rs485& got);

}  // namespace fxagent
