// A fault of a config, with its place in the file.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace fxagent {

struct ConfigError {
  std::string pointer;       ///< JSON pointer: "/devices/0/tags/3/address"
  int line = 0;              ///< 1-based; 0 if the error belongs to no line
  std::string text;          ///< the fault and its cure
  bool of_key = false;       ///< the fault is in the key at `pointer`, whatever the value
  std::size_t unlisted = 0;  ///< 0: a fault. Otherwise the number of further faults, as `text` says

  bool operator==(const ConfigError&) const = default;
};

using ConfigErrors = std::vector<ConfigError>;

/// Returns "/devices/0/tags/3/address: X8 is not octal …", without file and line.
inline std::string text_of(const ConfigError& error) {
  return error.pointer.empty() ? error.text : error.pointer + ": " + error.text;
}

/// Returns "agent.json:12: /devices/0/tags/3/address: X8 is not octal …".
inline std::string to_string(const ConfigError& error, std::string_view file) {
  std::string text(file);
  if (error.line > 0) text += ":" + std::to_string(error.line);
  return text + ": " + text_of(error);
}

}  // namespace fxagent
