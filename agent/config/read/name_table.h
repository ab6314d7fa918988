// Names that must be unique: those of links, of devices, and of the groups or tags of one device.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config/read/reader.h"

namespace fxagent {

/// Detects duplicate names among siblings and remembers where each name stands.
class NameTable {
 public:
  /// Adds a name. If it is taken, reports an error at `node` that names the other place too.
  void add(ConfigReader& reader, const std::string& name, const ConfigNode& node,
           std::uint32_t index);
  std::optional<std::uint32_t> find(std::string_view name) const;
  /// Returns what to append to the error at `at` about the unknown `name`: `none` if the table is
  /// empty; "; did you mean line1?"; or if no name is near "; there are line1, line2", with at most
  /// 8 names.
  std::string in_place_of(std::string_view name, ConfigReader& reader, const ConfigNode& at,
                          std::string_view none) const;

 private:
  struct Entry {
    std::uint32_t index = 0;
    const ConfigNode* node = nullptr;
  };
  std::map<std::string, Entry, std::less<>> entries_;
};

}  // namespace fxagent
