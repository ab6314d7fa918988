#include "agent/cli/doctor/fixed_config.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "agent/config/json/tree.h"

namespace fxagent {
namespace {

tl::expected<ConfigTree, ConfigTree::SyntaxError> parsed(const std::string& config) {
  return ConfigTree::parse(config, ConfigTree::Folding::none, {}, Comments::allowed);
}

/// Returns the entry of a list that has this name; nullptr if there is none.
const ConfigNode* entry_of(const ConfigNode* list, const std::string& name) {
  if (list == nullptr) return nullptr;
  for (const ConfigNode& entry : list->children)
    if (const ConfigNode* own = entry.find("name"); own != nullptr && own->text == name)
      return &entry;
  return nullptr;
}

/// Returns the object of the link, device or tag.
const ConfigNode* object_of(const ConfigNode& root, const KeyChange& change) {
  const ConfigNode* entry = entry_of(root.find(change.list), change.name);
  if (entry == nullptr || change.tag.empty()) return entry;
  return entry_of(entry->find("tags"), change.tag);
}

/// Returns the first byte from `at` on that is neither space nor comment.
std::size_t next_token(const std::string& text, std::size_t at) {
  for (;;) {
    at = std::min(text.find_first_not_of(" \t\r\n", at), text.size());
    if (text.compare(at, 2, "//") == 0)
      at = std::min(text.find('\n', at), text.size());
    else if (text.compare(at, 2, "/*") == 0)
      at = text.find("*/", at + 2) + 2;
    else
      return at;
  }
}

/// Replaces the value of a member, which is no object and no array.
void replace(std::string& text, const ConfigNode& member, const std::string& value) {
  const std::size_t colon = next_token(text, member.key_offset + 1);
  const std::size_t begin = next_token(text, colon + 1);
  const bool is_number =
      member.kind == ConfigNode::Kind::integer || member.kind == ConfigNode::Kind::number;
  // The offset of a number is the byte after it.
  text.replace(begin, member.offset + (is_number ? 0U : 1U) - begin, value);
}

/// Adds a member in front of the others, on a line of its own if they have that too.
void add(std::string& text, const ConfigNode& object, const std::string& member) {
  const std::size_t begin = object.offset + std::size_t{1};
  if (object.children.empty()) {
    text.insert(begin, member);
    return;
  }
  const std::size_t next = text.find_first_not_of(" \t\r\n", begin);
  const std::string space = text.substr(begin, next - begin);
  const bool has_lines = space.find('\n') != std::string::npos;
  text.insert(next, member + "," + (has_lines ? space : " "));
}

void apply(std::string& text, const KeyChange& change) {
  const auto tree = parsed(text);
  const ConfigNode* object = tree ? object_of(tree->root(), change) : nullptr;
  std::string key = change.key;
  if (const std::size_t slash = key.find('/'); slash != std::string::npos && object != nullptr) {
    object = object->find(key.substr(0, slash));
    key = key.substr(slash + 1);
  }
  if (object == nullptr) return;
  if (const ConfigNode* member = object->find(key))
    replace(text, *member, change.value);
  else
    add(text, *object, json_string(key) + ": " + change.value);
}

}  // namespace

std::string json_string(const std::string& text) {
  return nlohmann::json(text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::optional<std::string> pointer_of(const std::string& config, const KeyChange& change) {
  const auto tree = parsed(config);
  const ConfigNode* object = tree ? object_of(tree->root(), change) : nullptr;
  if (object == nullptr) return std::nullopt;
  return pointer_to(*object) + "/" + change.key;
}

std::string fixed_config(std::string config, const std::vector<KeyChange>& changes) {
  for (const KeyChange& change : changes) apply(config, change);
  return config;
}

}  // namespace fxagent
