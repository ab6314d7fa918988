#include "agent/cli/doctor/fixed_config.h"

#include <algorithm>
#include <functional>

#include "agent/config/json/syntax_fault.h"
#include "agent/config/json/tree.h"
#include "agent/text/json.h"

namespace fxagent {
namespace {

tl::expected<ConfigTree, ConfigError> parsed(const std::string& config) {
  return ConfigTree::parse(config, ConfigTree::Folding::none, kAnyTree, Comments::allowed);
}

/// Returns the entry of a list that has this name; nullptr if there is none.
const ConfigNode* entry_of(const ConfigNode* list, const std::string& name) {
  if (list == nullptr) return nullptr;
  for (const ConfigNode& entry : list->children)
    if (const ConfigNode* own = entry.find("name"); own != nullptr && own->text == name)
      return &entry;
  return nullptr;
}

/// A key of the file: its object, its name, and its member if it is set.
struct Place {
  const ConfigNode* object = nullptr;
  std::string key;
  const ConfigNode* member = nullptr;
};

/// Returns nullopt if the file has no object for it, or if its value is an object or array.
std::optional<Place> place_of(const ConfigNode& root, const KeyChange& change) {
  Place place{entry_of(root.find(change.list), change.name), change.key};
  if (place.object != nullptr && !change.tag.empty())
    place.object = entry_of(place.object->find("tags"), change.tag);
  const std::size_t slash = place.key.find('/');
  if (place.object != nullptr && slash != std::string::npos) {
    place.object = place.object->find(place.key.substr(0, slash));
    place.key.erase(0, slash + 1);
  }
  if (place.object == nullptr || place.object->kind != ConfigNode::Kind::object)
    return std::nullopt;
  place.member = place.object->find(place.key);
  using Kind = ConfigNode::Kind;
  if (place.member != nullptr &&
      (place.member->kind == Kind::object || place.member->kind == Kind::array))
    return std::nullopt;
  return place;
}

/// A part of the text and what replaces it.
struct Edit {
  std::size_t begin = 0;
  std::size_t bytes = 0;
  std::string text;
};

/// Replaces the value of `member`.
Edit replacement(const std::string& text, const ConfigNode& member, const std::string& value) {
  const std::size_t colon = next_token(text, member.key_offset + std::size_t{1}, Comments::allowed);
  const std::size_t begin = next_token(text, colon + 1, Comments::allowed);
  const bool is_number =
      member.kind == ConfigNode::Kind::integer || member.kind == ConfigNode::Kind::number;
  // The offset of a number is the byte after it.
  return {begin, member.offset + (is_number ? 0U : 1U) - begin, value};
}

/// Adds a member in front of the others, on a line of its own if they have that too.
Edit addition(const std::string& text, const ConfigNode& object, const std::string& member) {
  const std::size_t begin = object.offset + std::size_t{1};
  if (object.children.empty()) return {begin, 0, member};
  const std::size_t next = text.find_first_not_of(" \t\r\n", begin);
  const std::string space = text.substr(begin, next - begin);
  const bool has_lines = space.find('\n') != std::string::npos;
  return {next, 0, member + "," + (has_lines ? space : " ")};
}

}  // namespace

std::string json_string(const std::string& text) { return dumped(nlohmann::json(text)); }

std::optional<std::string> pointer_of(const std::string& config, const KeyChange& change) {
  const auto tree = parsed(config);
  const auto place = tree ? place_of(tree->root(), change) : std::nullopt;
  if (!place) return std::nullopt;
  return pointer_to(*place->object) + "/" + place->key;
}

std::string fixed_config(const std::string& config, const std::vector<KeyChange>& changes) {
  const auto tree = parsed(config);
  if (!tree) return config;
  std::vector<Edit> edits;
  for (const KeyChange& change : changes)
    if (const auto place = place_of(tree->root(), change))
      edits.push_back(
          place->member != nullptr
              ? replacement(config, *place->member, change.value)
              : addition(config, *place->object, json_string(place->key) + ": " + change.value));
  // From the end, so that the places of the others stay as they are.
  std::ranges::sort(edits, std::greater{}, &Edit::begin);
  std::string fixed = config;
  for (const Edit& edit : edits) fixed.replace(edit.begin, edit.bytes, edit.text);
  return fixed;
}

}  // namespace fxagent
