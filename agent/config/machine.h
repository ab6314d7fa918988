// Compares a config with this machine: files, credentials and serial ports.
#pragma once

#include <string>

#include "agent/config/config_error.h"
#include "agent/config/model.h"

namespace fxagent {

/// Returns the resources of the config that this machine lacks: certificates and password files
/// that cannot be read or are directories, a password variable that is not set, a store or recorder
/// that cannot be written. Pointers are those of the file; lines are 0. Changes nothing on disk.
ConfigErrors check_files(const Config& config);

/// Returns password files without a password, and the password and key files that too many users
/// can read: all users, or the group of a file that this user owns. Skips credentials that systemd
/// passes on, since their access lists show as group permissions, and files in /run/secrets. Also
/// returns the token file once for each of its lines that is too long, has a token that is too
/// short, or repeats one. Pointers and lines as above.
ConfigErrors weak_secrets(const Config& config);

/// Returns the ports that are missing, that this user may not open, or that another program uses.
/// An agent that runs the config file `file` does not count as another program. Pointers are those
/// of the file; lines are 0. Does not open the ports, since that would raise DTR.
ConfigErrors unavailable_ports(const Config& config, const std::string& file);

/// Logs the warnings of `config` before it comes into force, and clears them. Also logs the files
/// of weak_secrets().
void log_warnings(Config& config);

}  // namespace fxagent
