// Changes of a config that `fxagent doctor` recommends, and a copy of the config with them. Pure.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace fxagent {

/// One key of a link, a device or a tag, and its new value.
struct KeyChange {
  std::string list;   ///< "links" or "devices"
  std::string name;   ///< of the link or device
  std::string tag{};  ///< of a device; empty: the key is the device's own
  std::string key;    ///< "serial/parity"
  std::string value;  ///< JSON: "\"even\"", "5"
};

/// Returns the text as a JSON string.
std::string json_string(const std::string& text);

/// Returns the JSON pointer of the key in this config, such as "/devices/0/unit". nullopt if the
/// entry is not in the file under its name, because a template, `n` or a variable makes it, or if
/// the value of the key is an object or an array.
std::optional<std::string> pointer_of(const std::string& config, const KeyChange& change);

/// Returns the config with the changes that have a pointer. Everything else stays as it is written,
/// comments included.
std::string fixed_config(const std::string& config, const std::vector<KeyChange>& changes);

}  // namespace fxagent
