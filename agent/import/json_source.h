// Reads JSON files of other programs, with line numbers for the notes. A missing value, or one of
// another type, reads as empty.
#pragma once

#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>

#include "agent/config/json/tree.h"
#include "agent/import/imported.h"

namespace fxagent {

/// Parses the whole text. Error: why it is not JSON.
tl::expected<ConfigTree, ImportFault> json_source(std::string_view text);

std::string_view text_at(const ConfigNode& node, std::string_view key);
std::optional<double> number_at(const ConfigNode& node, std::string_view key);
std::optional<std::int64_t> integer_at(const ConfigNode& node, std::string_view key);
/// Returns the members or items of `key`; empty if there is no such key.
const std::vector<ConfigNode>& children_at(const ConfigNode& node, std::string_view key);

/// Notes the keys of an object that are not in `known`, so that none is dropped silently. Skips
/// empty values (null, "", an empty list). `what` names the object.
void note_other_keys(Imported& out, const ConfigTree& tree, const ConfigNode& node,
                     const std::string& what, std::initializer_list<std::string_view> known);

}  // namespace fxagent
