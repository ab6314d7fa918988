// `fxagent doctor`: asks the devices of a config on their lines, and names the config key behind
// each fault. `fxagent scan`: finds what answers on a port without a config. Neither writes to a
// device.
#pragma once

#include <string>

#include "agent/config/model.h"

namespace fxagent {

struct DoctorQuestion {
  std::string fix;  ///< file for a copy of the config with the changes; empty: none
};

/// Prints a line for each link and device, and for each finding the change of the config. Returns
/// the exit status: 0 nothing found; 1 a link or device does not answer, or the copy cannot be
/// written; 3 another process uses a link; 4 something does not match the config.
int run_doctor(const Config& config, const std::string& path, const DoctorQuestion& what);

/// Asks on a serial port by each serial protocol. Prints the longest time beforehand, its progress
/// on stderr, and at the end a section for a config. Returns 0 if something answers, 1 if nothing
/// does, 3 if another process uses the port.
int run_scan(const std::string& port);

}  // namespace fxagent
