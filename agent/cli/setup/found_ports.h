// Finds the serial ports of this machine, for a menu.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace fxagent {

struct FoundPort {
  std::string path;  ///< "/dev/serial/by-id/usb-FTDI_…" if there is one, else "/dev/ttyS0"
  std::string note;  ///< "ttyUSB0" for a path by id; else empty
};

/// Returns the ports that have hardware, USB ports first. USB ports carry the name that stays the
/// same when the adapter is plugged in again. Opens no port. `root` contains /dev and /sys.
std::vector<FoundPort> found_serial_ports(const std::filesystem::path& root = "/");

}  // namespace fxagent
