// RS-485 on two wires: the kernel opens the transmitter with the RTS line while the port sends, and
// closes it behind the last bit, sooner than any program could. Source: Linux
// Documentation/driver-api/serial/serial-rs485.rst.
#pragma once

#include <string>

#include "agent/config/config.h"

struct serial_rs485;

namespace fxagent {

/// Has the driver of an open port switch the direction. Empty, or what the port cannot do and what
/// to do about it, to stand behind the port's path.
std::string switch_direction(int fd, const Rs485& wish);

/// `wish` as the kernel takes it.
serial_rs485 kernel_settings(const Rs485& wish);

/// What of `asked` a driver did not take, by what it `got`: it may change a setting without an
/// error. Empty: nothing.
std::string not_taken(const serial_rs485& asked, const serial_rs485& got);

}  // namespace fxagent
