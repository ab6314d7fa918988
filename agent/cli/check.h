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

/// Prints what is wrong on stderr and one line on stdout where nothing is. `desired`: the file of a
/// remote config that is judged in its place; empty: none. Exit status: 0, or 2 where the config is
/// wrong.
int run_check(const std::string& path, const std::string& desired);

}  // namespace fxagent
