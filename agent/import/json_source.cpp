#include "agent/import/json_source.h"

#include <algorithm>
#include <cmath>

namespace fxagent {

using Kind = ConfigNode::Kind;

tl::expected<ConfigTree, ImportFault> json_source(std::string_view text) {
  auto tree = ConfigTree::parse(text, ConfigTree::Folding::none);
  if (!tree) return tl::unexpected(ImportFault{tree.error().line, tree.error().text});
  return std::move(*tree);
}

std::string_view text_at(const ConfigNode& node, std::string_view key) {
  const ConfigNode* found = node.find(key);
  return found != nullptr && found->kind == Kind::string ? std::string_view(found->text)
                                                         : std::string_view();
}

std::optional<double> number_at(const ConfigNode& node, std::string_view key) {
  const ConfigNode* found = node.find(key);
  const bool is_number =
      found != nullptr && (found->kind == Kind::integer || found->kind == Kind::number);
  return is_number ? std::optional(found->number) : std::nullopt;
}

std::optional<std::int64_t> integer_at(const ConfigNode& node, std::string_view key) {
  constexpr double kExact = 9007199254740992.0;
  const auto number = number_at(node, key);
  if (!number || std::abs(*number) > kExact || *number != std::trunc(*number)) return std::nullopt;
  return static_cast<std::int64_t>(*number);
}

const std::vector<ConfigNode>& children_at(const ConfigNode& node, std::string_view key) {
  static const std::vector<ConfigNode> none;
  const ConfigNode* found = node.find(key);
  return found == nullptr ? none : found->children;
}

void note_other_keys(Imported& out, const ConfigTree& tree, const ConfigNode& node,
                     const std::string& what, std::initializer_list<std::string_view> known) {
  std::string list;
  for (const ConfigNode& member : node.children) {
    const bool says_nothing =
        member.kind == Kind::null || (member.kind == Kind::string && member.text.empty()) ||
        ((member.kind == Kind::array || member.kind == Kind::object) && member.children.empty());
    if (says_nothing || std::ranges::find(known, std::string_view(member.key)) != known.end())
      continue;
    list += (list.empty() ? "" : ", ") + std::string(member.key);
  }
  if (!list.empty()) out.note(tree.line_of(node.offset), "not imported: " + list + " of " + what);
}

}  // namespace fxagent
