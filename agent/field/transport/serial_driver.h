// What the driver of a serial port does beyond termios: RS-485 and low latency.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "agent/config/model.h"

struct serial_rs485;

namespace fxagent {

// Two-wire RS-485: the kernel enables the transmitter by the RTS line while the port sends, and
// disables it after the last bit, sooner than any program could. Source: Linux
// Documentation/driver-api/serial/serial-rs485.rst.

/// Makes the driver of an open port switch the direction. Returns an empty text, or what the port
/// cannot do and what to do about it; the text follows the port's path.
std::string switch_direction(int fd, const Rs485& wish);

/// Converts `wish` to the kernel's structure.
serial_rs485 kernel_settings(const Rs485& wish);

/// Returns the setting of `asked` that the driver did not accept, judged by what it `got`; empty:
/// none. A driver may change a setting without an error.
std::string not_taken(const serial_rs485& asked, const serial_rs485& got);

// FTDI USB serial adapters hold a small reply back for 16 ms to wait for more bytes, unless
// configured otherwise: at 9600 baud that is half the time of a one-word exchange. Source: Linux
// drivers/usb/serial/ftdi_sio.c (ASYNC_LOW_LATENCY, latency_timer).

/// The settings that the driver accepted. A refusal is not an error.
struct LowLatency {
  bool flag_taken = false;      ///< the driver accepted ASYNC_LOW_LATENCY, which any user may set
  std::optional<int> timer_ms;  ///< latency_timer of the adapter, if it has one
};

/// Asks the driver of an open port to deliver every byte at once, by the flag and by the timer.
/// Setting the timer needs write access to sysfs: root, or a udev rule. `devices` is /sys/dev/char;
/// tests use another path.
LowLatency ask_for_low_latency(int fd, const std::filesystem::path& devices = "/sys/dev/char");

}  // namespace fxagent
