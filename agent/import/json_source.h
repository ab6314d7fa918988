// Reading of JSON files of other programs, with lines for the notes. What is missing or of another
// kind comes out empty.
#pragma once

#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>

#include "agent/config/tree.h"
#include "agent/import/imported.h"

namespace fxagent {

/// The whole text, or why it is no JSON.
tl::expected<ConfigTree, ImportFault> json_source(std::string_view text);

std::string_view text_at(const ConfigNode& node, std::string_view key);
std::optional<double> number_at(const ConfigNode& node, std::string_view key);
std::optional<std::int64_t> integer_at(const ConfigNode& node, std::string_view key);
/// The members or items below; of nothing where there is no such key.
const std::vector<ConfigNode>& children_at(const ConfigNode& node, std::string_view key);

/// The keys of an object that `known` does not have, with ", " between them: what of it would be
/// dropped in silence. Those that say nothing (null, "", an empty list) do not count.
std::string other_keys(const ConfigNode& node, std::initializer_list<std::string_view> known);

}  // namespace fxagent
