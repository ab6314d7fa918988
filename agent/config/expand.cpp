#include "agent/config/expand.h"

#include <algorithm>

#include "agent/config/json/pretty.h"
#include "agent/config/keys.h"
#include "agent/config/loader.h"
#include "agent/config/read/devices/templates.h"
#include "agent/process/this_process.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

using Kind = ConfigNode::Kind;

/// True if the key of that section is a number for devices of at least one protocol.
bool takes_number(std::string_view section, std::string_view name) {
  const auto takes = [&](const ConfigKey& key) { return key.name == name && key.is_number(); };
  if (std::ranges::any_of(config_section(section), takes)) return true;
  return section == "devices[]" && std::ranges::any_of(catalog(), [&](const ProtocolInfo& info) {
           return std::ranges::any_of(protocol_keys(info), takes);
         });
}

/// Replaces `{n}` in every string below the node, which is an object of `section` or a list of
/// them. A value that is just "{n}" becomes a number if its key takes one.
void put_n(ConfigNode& node, const std::string& section, const std::string& n) {
  for (ConfigNode& child : node.children) {
    const bool is_item = node.kind == Kind::array;
    const auto number = number_from<std::int64_t>(n);
    if (child.kind == Kind::string && child.text == "{n}" && number && !is_item &&
        takes_number(section, child.key)) {
      child.kind = Kind::integer;
      child.integer = *number;
    } else if (child.kind == Kind::string) {
      child.text = with_n(child.text, n);
    } else if (child.kind == Kind::array || child.kind == Kind::object) {
      put_n(child,
            is_item ? section : section + "." + child.key + (child.kind == Kind::array ? "[]" : ""),
            n);
    }
  }
}

/// Returns device `i` of the entry in full.
ConfigNode written_out(ConfigReader& reader, DeviceEntry& entry, std::size_t i) {
  const DeviceOrigin origin = entry.origin(i);
  reader.set_origin(entry.is_made() ? &origin : nullptr);
  ConfigNode device = entry.members();
  std::erase_if(device.children, [](const ConfigNode& member) {
    return member.key == "template" || member.key == "n";
  });
  const auto fill = [&](ConfigNode& list, KeyRef key) {
    if (list.key != key->name) return;
    for (const ConfigNode* item : entry.items(reader, key)) list.children.push_back(*item);
  };
  for (ConfigNode& member : device.children) {
    fill(member, "devices[].groups");
    fill(member, "devices[].tags");
  }
  if (!origin.n.empty()) put_n(device, "devices[]", origin.n);
  reader.set_origin(nullptr);
  return device;
}

}  // namespace

std::string expanded_config(std::string_view text, const Environment& environment) {
  const auto tree = ConfigTree::parse(text, ConfigTree::Folding::tags, {}, Comments::allowed);
  if (!tree) return {};
  ConfigReader reader(*tree, environment);
  const ConfigNode& top = tree->root();
  Templates templates(reader, top);
  std::string out = "{";
  for (const ConfigNode& member : top.children) {
    if (member.key == "templates") continue;
    out += out.size() == 1 ? "\n  " : ",\n  ";
    append_key(out, member.key);
    if (member.key != "devices") {
      ConfigNode whole = member;
      for (ConfigNode& entry : whole.children)  // the servers of brokers are folded, too
        for (ConfigNode& list : entry.children) list.children = tree->items_of(list);
      append_pretty(out, whole, 1);
      continue;
    }
    out += '[';
    bool is_first = true;
    for (const ConfigNode& node : member.children) {
      const auto entry = templates.entry(node);
      for (std::size_t i = 0; entry != nullptr && i < entry->count(); ++i) {
        out += is_first ? "\n    " : ",\n    ";
        is_first = false;
        append_pretty(out, written_out(reader, *entry, i), 2);
      }
    }
    out += is_first ? "]" : "\n  ]";
  }
  return out + "\n}\n";
}

tl::expected<std::string, std::vector<ConfigError>> expanded_config(const std::string& path) {
  std::string text;
  if (const auto config = load_config(path, &text); !config) return tl::unexpected(config.error());
  return expanded_config(text, process_environment);
}

}  // namespace fxagent
