#include "agent/config/read/name_table.h"

#include "agent/config/suggestions.h"

#include <algorithm>
#include <span>
#include <vector>

namespace fxagent {

void NameTable::add(ConfigReader& reader, const std::string& name, const ConfigNode& node,
                    std::uint32_t index) {
  const auto [entry, fresh] = entries_.emplace(name, Entry{index, &node});
  if (!fresh)
    reader.error(node, "\"" + name + "\" is already used as a name at " +
                           reader.place_of(*entry->second.node));
}

std::optional<std::uint32_t> NameTable::find(std::string_view name) const {
  const auto entry = entries_.find(name);
  return entry == entries_.end() ? std::nullopt : std::optional(entry->second.index);
}

std::string NameTable::in_place_of(std::string_view name, ConfigReader& reader,
                                   const ConfigNode& at, std::string_view none) const {
  if (entries_.empty()) return std::string(none);
  if (!reader.may_suggest(at.offset)) return {};
  constexpr std::size_t kMostShown = 8;
  std::vector<std::string_view> names;
  names.reserve(entries_.size());
  for (const auto& [known, entry] : entries_) names.push_back(known);
  if (std::string meant = did_you_mean(name, names); !meant.empty()) return meant;
  const std::span first(names.data(), std::min(kMostShown, names.size()));
  const std::string text =
      (names.size() == 1 ? "; there is " : "; there are ") + joined(first, ", ");
  return names.size() > kMostShown
             ? text + " and " + std::to_string(names.size() - kMostShown) + " more"
             : text;
}

}  // namespace fxagent
