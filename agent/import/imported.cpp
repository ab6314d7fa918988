#include "agent/import/imported.h"

#include <algorithm>
#include <cmath>
#include <ranges>
#include <utility>

#include "agent/config/json/pretty.h"
#include "agent/config/keys.h"
#include "agent/config/loader.h"
#include "agent/config/source.h"
#include "agent/text/json.h"
#include "agent/text/json_writer.h"
#include "agent/text/text.h"
#include "protocol/catalog.h"
#include "protocol/letter_case.h"

namespace fxagent {
namespace {

using Kind = ConfigNode::Kind;

constexpr std::size_t kLongestName = 64;
constexpr std::int64_t kLongestInterval = config_key("devices[].groups[].interval_ms").limits.max;
constexpr std::int64_t kModbusAddresses = 65536;
constexpr int kPorts = 65536;
constexpr auto kExact = static_cast<double>(json::kMaxExactInteger);

/// Returns the tag's name if it is to be made valid: a placeholder such as {n} is part of a valid
/// name. Otherwise returns an empty string.
std::string raw_name(const ImportedTag& tag) {
  std::string name = text_at(tag.keys, "name");
  if (name.find('{') != name.npos) name.clear();
  return name;
}

/// With raw names, the tags get other, valid ones: errors in names would hide those of values.
JsonObject json_of(const ImportedDevice& device, bool has_raw_names) {
  JsonObject out = device.keys;
  for (const JsonObject& group : device.groups) out["groups"].push_back(group);
  for (const ImportedTag& tag : device.tags) {
    JsonObject& keys = out["tags"].emplace_back(tag.keys);
    if (has_raw_names && !raw_name(tag).empty())
      keys["name"] = "raw_name_" + std::to_string(out["tags"].size());
  }
  return out;
}

JsonObject json_of(const Imported& imported) {
  JsonObject out = imported.sections;
  out.emplace("agent", JsonObject::object({{"id", "edge1"}}));
  out.emplace("mqtt", JsonObject::object({{"servers", {"mqtt://127.0.0.1:1883"}}}));
  out["links"] = imported.links;
  JsonObject& devices = out["devices"] = JsonObject::array();
  for (const ImportedDevice& device : imported.devices)
    devices.push_back(json_of(device, imported.has_raw_names));
  return out;
}

/// Removes "PREFIX3" from the front of a pointer and returns 3; nullopt if the prefix differs.
std::optional<std::size_t> take_index(std::string_view& pointer, std::string_view prefix) {
  if (!pointer.starts_with(prefix)) return std::nullopt;
  const std::string_view rest = pointer.substr(prefix.size());
  const std::string_view digits = rest.substr(0, rest.find('/'));
  pointer = rest.substr(digits.size());
  return number_from<std::size_t>(digits);
}

/// Returns "timeout_ms" for "/timeout_ms"; empty if the pointer is not a direct key of the object.
std::string_view key_in(std::string_view pointer) {
  const std::string_view key = pointer.starts_with('/') ? pointer.substr(1) : std::string_view();
  return key.find('/') == key.npos ? key : std::string_view();
}

/// Returns the port of "host:port"; nullopt for any other text.
std::optional<int> port_number(std::string_view port) {
  const std::size_t colon = port.rfind(':');
  if (colon == port.npos || colon == 0) return std::nullopt;
  const auto number = number_from<int>(port.substr(colon + 1));
  return number && *number > 0 && *number < kPorts ? number : std::nullopt;
}

/// Indexes of a device and of one of its tags.
using TagIndexes = std::pair<std::size_t, std::size_t>;

struct TagFault {
  std::string key;  ///< "address", "states/5"; empty: the tag as a whole
  std::string text;
};

/// Returns the errors of each tag, except of tags that are part of the device's keys.
std::map<TagIndexes, std::vector<TagFault>> faults_of_tags(const Imported& imported,
                                                           const std::vector<ConfigError>& errors) {
  std::map<TagIndexes, std::vector<TagFault>> faults;
  for (const ConfigError& error : errors) {
    std::string_view pointer = error.pointer;
    const auto device = take_index(pointer, "/devices/");
    const auto tag = take_index(pointer, "/tags/");
    if (!device || !tag || *tag >= imported.devices[*device].tags.size()) continue;
    if (pointer.starts_with('/')) pointer.remove_prefix(1);
    faults[{*device, *tag}].push_back({std::string(pointer), error.text});
  }
  return faults;
}

/// Removes the tags that have errors, or only their access or description if the errors are there.
/// Returns false if there was nothing to remove.
bool drop_refused(Imported& imported, const std::vector<ConfigError>& errors) {
  const auto refused = faults_of_tags(imported, errors);
  for (const auto& [place, faults] : std::views::reverse(refused)) {
    auto& tags = imported.devices[place.first].tags;
    const auto tag = tags.begin() + static_cast<std::ptrdiff_t>(place.second);
    // These keys do not affect the values.
    const std::string key = faults.front().key;
    const bool is_spared =
        (key == "access" || key == "description") &&
        std::ranges::all_of(faults, [&](const TagFault& fault) { return fault.key == key; });
    std::string text = dumped(JsonObject(text_at(tag->keys, "name")));
    std::string_view separator = ": ";
    for (const TagFault& fault : faults) {
      text += separator;
      if (!is_spared && !fault.key.empty()) text += fault.key + ": ";
      text += fault.text;
      separator = "; ";
    }
    if (is_spared) {
      text.insert(0, "not imported: the " + key + " of ");
      imported.note(tag->line, std::move(text));
      tag->keys.erase(key);
      tag->is_changed = true;
    } else {
      imported.leave_out(tag->line, text);
      tags.erase(tag);
    }
  }
  return !refused.empty();
}

/// Makes the names of all tags valid and unique in their device. Valid names stay: others are made
/// from what is left.
void name_tags(Imported& imported) {
  imported.has_raw_names = false;
  for (ImportedDevice& device : imported.devices) {
    NameMaker names(NameMaker::Source::name);
    std::vector<ImportedTag*> others;
    for (ImportedTag& tag : device.tags) {
      const std::string name = raw_name(tag);
      if (!name.empty() && (!is_name(name) || !names.reserve(name))) others.push_back(&tag);
    }
    for (ImportedTag* tag : others) {
      const std::size_t before = imported.notes.size();
      tag->keys["name"] = names.make(text_at(tag->keys, "name"), "tag", tag->line, imported.notes);
      tag->is_changed = tag->is_changed || imported.notes.size() > before;
    }
  }
}

/// Removes a wrong setting from a link's `serial`, except the port.
bool drop_of_link(Imported& imported, const ConfigError& error, std::string_view pointer,
                  std::size_t index) {
  constexpr std::string_view kSerial = "/serial";
  if (index >= imported.links.size() || !pointer.starts_with(kSerial)) return false;
  JsonObject& link = imported.links[index];
  const std::string key(key_in(pointer.substr(kSerial.size())));
  if (key == "path" || !link.contains("serial") || !link["serial"].contains(key)) return false;
  link["serial"].erase(key);
  imported.note(0, "not imported: " + key + " of " + text_at(link, "name") + ": " + error.text);
  return true;
}

/// Removes an invalid time of a device or group. For any other key it removes the whole device,
/// because its values would differ without the key.
bool drop_of_device(Imported& imported, const ConfigError& error, std::string_view pointer,
                    std::size_t index) {
  if (index >= imported.devices.size()) return false;
  ImportedDevice& device = imported.devices[index];
  const auto group = take_index(pointer, "/groups/");
  if (group && *group >= device.groups.size()) return false;
  JsonObject& object = group ? device.groups[*group] : device.keys;
  const std::string key(key_in(pointer));
  if (!object.contains(key)) return false;
  const std::string name = text_at(device.keys, "name");
  if (key == "timeout_ms" || key == "interval_ms") {
    object.erase(key);
    imported.note(0, "not imported: " + key + " of " + name + ": " + error.text);
    return true;
  }
  imported.note(0, "left out: the device " + name + ": " + key + ": " + error.text +
                       (key == "model" ? " (--protocol names the protocol)" : ""));
  imported.left_out += device.tags.size();
  imported.devices.erase(imported.devices.begin() + static_cast<std::ptrdiff_t>(index));
  return true;
}

/// Does the same for links and devices of other programs: one odd number must not cost the whole
/// file. Removes one at a time, because each removal shifts the rest.
bool drop_one_setting(Imported& imported, const std::vector<ConfigError>& errors) {
  // From a complete exported config only tags are left out.
  if (!imported.sections.empty()) return false;
  return std::ranges::any_of(errors, [&](const ConfigError& error) {
    std::string_view pointer = error.pointer;
    if (const auto link = take_index(pointer, "/links/"))
      return drop_of_link(imported, error, pointer, *link);
    const auto device = take_index(pointer, "/devices/");
    return device && drop_of_device(imported, error, pointer, *device);
  });
}

}  // namespace

void describe(ImportedTag& tag, std::string_view text) {
  if (!text.empty()) tag.keys["description"] = literal(text);
}

std::string literal(std::string_view text) {
  std::string spelled(text);
  for (auto at = spelled.find("${"); at != spelled.npos; at = spelled.find("${", at + 2))
    spelled.insert(at, 1, '$');
  return spelled;
}

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
    if (says_nothing || contains(known, std::string_view(member.key))) continue;
    list += (list.empty() ? "" : ", ") + std::string(member.key);
  }
  if (!list.empty()) out.note(tree.line_of(node.offset), "not imported: " + list + " of " + what);
}

std::string NameMaker::make(std::string_view wanted, std::string_view fallback, int line,
                            std::vector<ImportNote>& notes) {
  std::string name;
  bool is_whole = true;
  for (const char c : lower(wanted)) {
    if ((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '_') {
      name += c;
    } else {
      is_whole = is_whole && source_ == Source::text && static_cast<unsigned char>(c) < 0x80;
      if (!name.empty() && name.back() != '_') name += '_';
    }
  }
  while (!name.empty() && name.back() == '_' && !wanted.ends_with('_')) name.pop_back();
  if (name.empty()) name = fallback;
  const bool is_cut = name.size() > kLongestName;
  name.resize(std::min(name.size(), kLongestName));
  const std::string plain = name;
  int& next = next_.try_emplace(plain, 2).first->second;
  while (!taken_.insert(name).second) {
    const std::string suffix = "_" + std::to_string(next++);
    name = plain.substr(0, kLongestName - suffix.size()) + suffix;
  }
  if (!is_whole || is_cut || name != plain)
    notes.push_back({line, "\"" + std::string(wanted) + "\" is named " + name + ": " +
                               (name != plain ? "the name was already used"
                                : is_cut      ? "a name has at most 64 characters"
                                              : "a name has only a-z, 0-9, _ and -")});
  return name;
}

std::string IntervalGroups::at(std::int64_t interval_ms) {
  interval_ms = std::clamp<std::int64_t>(interval_ms, 0, kLongestInterval);
  const std::string name = "every_" + std::to_string(interval_ms) + "_ms";
  if (known_.insert(interval_ms).second) {
    JsonObject group;
    group["name"] = name;
    group["interval_ms"] = interval_ms;
    if (on_change_) group["publish"] = "on_change";
    if (on_change_ && silent_) group["max_silent_s"] = *silent_;
    device_.groups.push_back(std::move(group));
  }
  return name;
}

std::optional<bool> LinkTable::is_serial(std::string_view port) {
  if (port.starts_with('/')) return true;
  return port_number(port) ? std::optional(false) : std::nullopt;
}

std::string LinkTable::to(const std::string& port, std::string_view protocol, int line,
                          const JsonObject& settings) {
  const auto on_serial = is_serial(port);
  if (!on_serial)
    return to_placeholder(protocol, line,
                          "not imported: the connection \"" + port + "\", whose port is wrong; ");
  // A link has one protocol, and two links cannot share a serial port.
  const std::string target = *on_serial ? port : port + " " + std::string(protocol);
  const auto [known, fresh] =
      names_.try_emplace(target, "line" + std::to_string(names_.size() + 1));
  if (!fresh) return known->second;
  JsonObject link;
  link["name"] = known->second;
  if (*on_serial) {
    JsonObject serial = settings;
    serial["path"] = literal(port);
    link["serial"] = std::move(serial);
  } else {
    std::string host = port.substr(0, port.rfind(':'));
    if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
    link["tcp"] = {{"host", literal(host)}, {"port", port_number(port).value_or(0)}};
  }
  imported_.links.push_back(std::move(link));
  return known->second;
}

std::string LinkTable::to_placeholder(std::string_view protocol, int line, const std::string& why) {
  imported_.note(line, why + placeholder_note(protocol));
  return to(placeholder_port(protocol), protocol);
}

ImportedDevice new_device(std::string_view name, std::string_view link, std::string_view protocol) {
  return {.keys = JsonObject::object({{"name", name}, {"link", link}, {"protocol", protocol}})};
}

ImportedDevice& add_device(Imported& out, LinkTable& links, const ImportOptions& options,
                           std::string_view name, std::string_view usual_protocol) {
  const std::string_view protocol = options.protocol.empty() ? usual_protocol : options.protocol;
  if (options.protocol.empty())
    out.note(0, std::string(name) + ": the protocol is assumed to be " + std::string(protocol) +
                    "; addresses depend on it, such as X10: set another with --protocol");
  const std::string link =
      options.port.empty() ? links.to_placeholder(protocol, 0) : links.to(options.port, protocol);
  ImportedDevice& device = out.devices.emplace_back(new_device(name, link, protocol));
  if (!options.model.empty()) device.keys["model"] = options.model;
  return device;
}

std::string modbus_address(std::string_view table, std::int64_t number) {
  if (table.empty() || number < 0 || number >= kModbusAddresses) return {};
  return std::string(table) + ":" + std::to_string(number);
}

std::string melsec_bit_address(std::string_view text) {
  const std::size_t dot = text.rfind('.');
  if (dot == text.npos) return std::string(text);
  const auto bit = number_from<int>(text.substr(dot + 1));
  if (!bit || *bit < 0 || *bit > 15) return std::string(text);
  return std::string(text.substr(0, dot + 1)) + "0123456789ABCDEF"[*bit];
}

std::string placeholder_port(std::string_view protocol) {
  const ProtocolInfo* info = find_protocol(protocol);
  return info != nullptr && !info->on_serial ? "192.0.2.1:502" : "/dev/ttyUSB0";
}

std::string placeholder_note(std::string_view protocol) {
  return "the link is a placeholder, " + placeholder_port(protocol) +
         ": set the real one, as with --port";
}

ImportOutcome finish(Imported imported) {
  ImportOutcome outcome;
  while (true) {
    std::erase_if(imported.devices, [](const ImportedDevice& device) {
      return device.tags.empty() && !device.may_be_empty;
    });
    const std::string text = dumped(json_of(imported));
    // The permissions of the file that the config is written to are not known.
    const auto config = parse_config(text, process_environment, FilePrivacy::owner_only);
    if (!config &&
        (drop_refused(imported, config.error()) || drop_one_setting(imported, config.error())))
      continue;
    if (imported.has_raw_names) {  // the names of tags that are left out are free by now
      name_tags(imported);
      continue;
    }
    if (config) {
      for (const DeviceConfig& device : config->devices) outcome.tags += device.tags.size();
      for (const ImportedDevice& device : imported.devices)
        outcome.changed +=
            static_cast<std::size_t>(std::ranges::count_if(device.tags, &ImportedTag::is_changed));
      if (outcome.tags > 0 || !imported.sections.empty()) outcome.config = pretty_text(text);
    } else {
      for (const ConfigError& error : config.error()) imported.note(0, text_of(error));
    }
    break;
  }
  outcome.left_out = imported.left_out;
  std::ranges::stable_sort(imported.notes, {}, &ImportNote::line);
  outcome.notes = std::move(imported.notes);
  return outcome;
}

}  // namespace fxagent
