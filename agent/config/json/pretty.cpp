#include "agent/config/json/pretty.h"

#include "agent/text/text.h"

namespace fxagent {
namespace {

using Kind = ConfigNode::Kind;

// A value that fits within this width is written on one line.
constexpr std::size_t kLine = 100;
constexpr std::size_t kIndent = 2;

bool is_bracket(const ConfigNode& node) {
  return node.kind == Kind::array || node.kind == Kind::object;
}

/// Appends the node on one line. Stops early if `out` grows beyond `most` bytes.
void append_flat(std::string& out, const ConfigNode& node, std::size_t most) {
  if (node.kind == Kind::string) return append_json_string(out, node.text);
  if (!is_bracket(node)) {
    out += node.kind == Kind::null      ? "null"
           : node.kind == Kind::boolean ? (node.boolean ? "true" : "false")
           : node.kind == Kind::integer ? std::to_string(node.integer)
                                        : node.text;
    return;
  }
  const bool is_object = node.kind == Kind::object;
  out += is_object ? '{' : '[';
  for (const ConfigNode& child : node.children) {
    if (&child != &node.children.front()) out += ", ";
    if (is_object) append_key(out, child.key);
    if (out.size() > most) return;
    append_flat(out, child, most);
  }
  out += is_object ? '}' : ']';
}

}  // namespace

void append_key(std::string& out, std::string_view key) {
  append_json_string(out, key);
  out += ": ";
}

void append_pretty(std::string& out, const ConfigNode& node, std::size_t depth) {
  const std::size_t start = out.size();
  const std::size_t most = start + kLine - kIndent * depth;
  append_flat(out, node, most);
  if (!is_bracket(node) || node.children.empty() || out.size() <= most) return;
  out.resize(start);
  const bool is_object = node.kind == Kind::object;
  out += is_object ? '{' : '[';
  for (const ConfigNode& child : node.children) {
    if (&child != &node.children.front()) out += ',';
    out += '\n' + std::string(kIndent * (depth + 1), ' ');
    if (is_object) append_key(out, child.key);
    append_pretty(out, child, depth + 1);
  }
  out += '\n' + std::string(kIndent * depth, ' ') + (is_object ? '}' : ']');
}

std::string pretty_text(std::string_view json) {
  const auto tree = ConfigTree::parse(json, ConfigTree::Folding::none, kAnyTree);
  if (!tree) return {};
  std::string out;
  append_pretty(out, tree->root(), 0);
  return out + "\n";
}

}  // namespace fxagent
