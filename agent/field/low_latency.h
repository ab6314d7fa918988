// USB serial adapters of FTDI's hold a small reply back for 16 ms, in the hope of more, unless they
// are asked not to: at 9600 baud that is half of what a one-word exchange takes. Source: Linux
// drivers/usb/serial/ftdi_sio.c (ASYNC_LOW_LATENCY, latency_timer).
#pragma once

#include <filesystem>
#include <optional>

namespace fxagent {

/// What became of the wish; nothing of it is an error.
struct LowLatency {
  bool flag_taken = false;      ///< the driver keeps ASYNC_LOW_LATENCY: an ordinary user may set it
  std::optional<int> timer_ms;  ///< latency_timer of the adapter, where it has one
};

/// Asks the driver of an open port to hand every byte on at once, by both ways it may have. Setting
/// the timer needs write access to sysfs: root, or a udev rule. `devices` is /sys/dev/char; tests
/// have another.
LowLatency ask_for_low_latency(int fd, const std::filesystem::path& devices = "/sys/dev/char");

}  // namespace fxagent
