#include "agent/cli/check/config_places.h"

#include <algorithm>
#include <utility>

namespace fxagent {

ConfigPlaces::ConfigPlaces(std::string_view text) {
  auto tree = ConfigTree::parse(text, ConfigTree::Folding::tags, {}, Comments::allowed);
  if (tree) tree_ = std::make_unique<const ConfigTree>(std::move(*tree));
}

int ConfigPlaces::line(std::string_view pointer) const {
  if (!tree_) return 0;
  const ConfigNode* at = &tree_->root();
  while (!pointer.empty()) {
    pointer.remove_prefix(1);
    const std::string_view step = pointer.substr(0, pointer.find('/'));
    const auto next = std::ranges::find_if(at->children, [&](const ConfigNode& child) {
      return at->kind == ConfigNode::Kind::array ? std::to_string(child.index) == step
                                                 : child.key == step;
    });
    if (next == at->children.end()) break;
    at = &*next;
    pointer.remove_prefix(step.size());
  }
  return tree_->line_of(at->key_offset != 0 ? at->key_offset : at->offset);
}

std::string ConfigPlaces::device(std::string_view name) const {
  const ConfigNode* devices = tree_ ? tree_->root().find("devices") : nullptr;
  if (devices == nullptr) return "/devices";
  for (const ConfigNode& entry : devices->children)
    if (const ConfigNode* node = entry.find("name"); node != nullptr && node->text == name)
      return pointer_to(entry);
  return "/devices";
}

}  // namespace fxagent
