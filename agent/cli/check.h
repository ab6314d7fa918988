// `fxagent check`: whether a config file is right, and what this machine lacks for it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "agent/config/config.h"

namespace fxagent {

/// Prints them on stderr, one a line.
void print_errors(const std::vector<ConfigError>& errors, const std::string& path);

/// The config, or its errors on stderr.
std::optional<Config> loaded(const std::string& path);

struct CheckQuestion {
  std::string desired;   ///< file of a remote config that is judged in its place; empty: none
  bool online = false;   ///< open links and broker, and ask each device
  bool as_json = false;  ///< of `online`
};

/// Prints errors and warnings on stderr. Prints one line on stdout if the config is right, and
/// after it what run_online_check() finds. Returns the exit status: 2 if the config is wrong;
/// otherwise 0, or that of run_online_check().
int run_check(const std::string& path, const CheckQuestion& what);

}  // namespace fxagent
