// FTDI USB serial adapters hold a small reply back for 16 ms to wait for more bytes, unless
// configured otherwise: at 9600 baud that is half the time of a one-word exchange. Source: Linux
// drivers/usb/serial/ftdi_sio.c (ASYNC_LOW_LATENCY, latency_timer).
#pragma once

#include <filesystem>
#include <optional>

namespace fxagent {

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
