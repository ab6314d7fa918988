#include "agent/config/name_table.h"

namespace fxagent {

bool NameTable::add(ConfigReader& reader, const std::string& name, const ConfigNode& node,
                    std::uint32_t index) {
  const auto [entry, fresh] = entries_.emplace(name, Entry{index, &node});
  if (!fresh)
    reader.error(node,
                 "\"" + name + "\" is already the name at " + reader.place_of(*entry->second.node));
  return fresh;
}

std::optional<std::uint32_t> NameTable::find(std::string_view name) const {
  const auto entry = entries_.find(name);
  return entry == entries_.end() ? std::nullopt : std::optional(entry->second.index);
}

std::vector<std::string_view> NameTable::names() const {
  std::vector<std::string_view> list;
  list.reserve(entries_.size());
  for (const auto& [name, entry] : entries_) list.push_back(name);
  return list;
}

}  // namespace fxagent
