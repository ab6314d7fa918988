// What `fxagent init` finds and creates on this machine beside its files: the serial ports, for a
// menu, and a password file for the user of the service.
#pragma once

#include <filesystem>
#include <string>
#include <tl/expected.hpp>
#include <vector>

namespace fxagent {

struct FoundPort {
  std::string path;  ///< "/dev/serial/by-id/usb-FTDI_…" if there is one, else "/dev/ttyS0"
  std::string note;  ///< "ttyUSB0" for a path by id; else empty
};

/// Returns the ports that have hardware, USB ports first. USB ports carry the name that stays the
/// same when the adapter is plugged in again. Opens no port. `root` contains /dev and /sys.
std::vector<FoundPort> found_serial_ports(const std::filesystem::path& root = "/");

struct PasswordFile {
  bool is_new = false;  ///< false: the file existed and is unchanged
  std::string owner;    ///< owner of a new file: "fxagent"
};

/// Creates `path` with mode 600 and `password` in it. When run by root, gives it to the user
/// `owner` if that user exists; otherwise it belongs to the caller. Error: why it cannot be
/// created; no new file is left.
tl::expected<PasswordFile, std::string> create_password_file(const std::string& path,
                                                             const std::string& password,
                                                             const std::string& owner);

}  // namespace fxagent
