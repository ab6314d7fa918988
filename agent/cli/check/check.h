// `fxagent check`: validates a config file and checks that this machine can run it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "agent/config/config_error.h"
#include "agent/config/model.h"

namespace fxagent {

/// Prints the errors on stderr, one a line.
void print_errors(const std::vector<ConfigError>& errors, const std::string& path);

/// Loads a config. Prints the errors on stderr and returns nullopt if it is wrong.
std::optional<Config> loaded(const std::string& path);
/// The same for a call that uses the lines itself. Prints a note if another gateway may use them.
std::optional<Config> loaded_for_lines(const std::string& path);

struct CheckQuestion {
  std::string desired;   ///< file with a remote config to check instead; empty: none
  std::string target;    ///< broker to check the config for, as in check_target.h; empty: none
  bool online = false;   ///< open links and broker, and query each device
  bool as_json = false;  ///< output of `online` as JSON
};

/// Opens the links and the brokers of a config and queries each device, with reads alone. Skips a
/// link that another process holds, and every link if an agent on this machine runs this config.
/// Prints its findings on stdout and returns exit_status() of online_report.h. `path` is the file.
int run_online_check(const Config& config, const std::string& path, bool as_json);

/// Prints errors and warnings on stderr. Prints one line on stdout if the config is right, and
/// after it what the target refuses or run_online_check() finds. Returns the exit status: 2 if the
/// config or the target is wrong; 1 if the target refuses something; otherwise 0, or that of
/// run_online_check().
int run_check(const std::string& path, const CheckQuestion& what);

}  // namespace fxagent
