// Names that must differ: those of links, of devices, of the groups or the tags of one device.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config/reader.h"

namespace fxagent {

/// Finds names that are given twice among siblings, and where the first one stands.
class NameTable {
 public:
  /// False, and an error at `node` that names both places, where the name is taken.
  bool add(ConfigReader& reader, const std::string& name, const ConfigNode& node,
           std::uint32_t index);
  std::optional<std::uint32_t> find(std::string_view name) const;
  std::vector<std::string_view> names() const;
  bool empty() const { return entries_.empty(); }

 private:
  struct Entry {
    std::uint32_t index = 0;
    const ConfigNode* node = nullptr;
  };
  std::map<std::string, Entry, std::less<>> entries_;
};

}  // namespace fxagent
