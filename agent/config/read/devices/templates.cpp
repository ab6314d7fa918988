#include "agent/config/read/devices/templates.h"

#include <algorithm>
#include <memory>
#include <ranges>
#include <tl/expected.hpp>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "agent/config/keys.h"
#include "agent/config/suggestions.h"
#include "agent/text/text.h"
#include "protocol/catalog.h"
#include "protocol/range_ends.h"

namespace fxagent {
namespace {

using Kind = ConfigNode::Kind;

// Sizes for the limit on devices written out in full.
/// A device without its groups and tags.
constexpr std::size_t kBytesOfFilledDevice = 256;
/// Quotes and separator of a key or an item.
constexpr std::size_t kBytesAround = 4;
/// One address in `commands.allow`.
constexpr std::size_t kBytesOfAllowed = 16;
/// `{n}` in the file.
constexpr std::size_t kBytesOfPlace = 3;
constexpr std::size_t kLongestNumber = 9;
constexpr std::string_view kWanted =
    "must be a range such as \"1-40\" or \"1-8,12\", or a list of numbers or names";

std::string too_many() {
  return "makes more than " + std::to_string(Templates::max_devices) + " devices";
}

/// Returns the number in `digits`; nullopt if it has other characters or more than kLongestNumber.
std::optional<std::size_t> number_in(std::string_view digits) {
  return digits.size() > kLongestNumber ? std::nullopt : number_from<std::size_t>(digits);
}

std::string padded(std::size_t number, std::size_t width) {
  const std::string text = std::to_string(number);
  return text.size() < width ? std::string(width - text.size(), '0') + text : text;
}

/// Merges the groups or tags of a template and an entry; see DeviceEntry::items().
std::vector<const ConfigNode*> added(ConfigReader& reader, const std::vector<ConfigNode>& base,
                                     const std::vector<ConfigNode>& own) {
  const auto name_of = [&](const ConfigNode& item) {
    const ConfigNode* name = item.find("name");
    return name == nullptr ? std::string() : reader.replaced(*name);
  };
  std::vector<const ConfigNode*> list;
  list.reserve(base.size() + own.size());
  for (const ConfigNode& item : base) list.push_back(&item);
  std::unordered_map<std::string, std::size_t> places;  // in `base`, by name
  for (std::size_t i = 0; !own.empty() && i < base.size(); ++i) places.emplace(name_of(base[i]), i);
  places.erase("");
  for (const ConfigNode& item : own) {
    const auto replaced = places.empty() ? places.end() : places.find(name_of(item));
    if (replaced == places.end()) {
      list.push_back(&item);
      continue;
    }
    list[replaced->second] = &item;
    places.erase(replaced);
  }
  return list;
}

/// Returns the bytes that the node takes in the file.
std::size_t size_of(const ConfigNode& node) {
  if (node.end != 0) return node.end - node.offset;  // folded
  std::size_t size = node.key.size() + node.text.size() + kBytesAround;
  for (const ConfigNode& child : node.children) size += size_of(child);
  return size;
}

/// Returns the values of `{n}` for a range such as "1-40" or "01-12,15". If the first number of a
/// range begins with 0, all of the range are padded to its length. The error is an error text for
/// the user.
tl::expected<std::vector<std::string>, std::string> numbers_of_range(std::string_view text) {
  const std::string wanted = std::string(kWanted) + ", found \"" + shown(text) + "\"";
  std::vector<std::string> list;
  while (true) {
    const std::string_view part = text.substr(0, text.find(','));
    const RangeEnds ends = range_ends(part);
    const auto from = number_in(ends.first);
    const auto to = number_in(ends.last.value_or(ends.first));
    if (!from || !to) return tl::unexpected(wanted);
    if (*from > *to)
      return tl::unexpected("the range " + std::string(part) + " ends before it begins");
    if (*to - *from >= Templates::max_devices - list.size()) return tl::unexpected(too_many());
    const std::size_t width = ends.first.front() == '0' ? ends.first.size() : 0;
    for (std::size_t n = *from; n <= *to; ++n) list.push_back(padded(n, width));
    if (part.size() == text.size()) return list;
    text.remove_prefix(part.size() + 1);
  }
}

}  // namespace

// ---- one entry --------------------------------------------------------------------------------

const std::vector<ConfigNode>& DeviceLists::items(ConfigReader& reader, KeyRef key) {
  const auto [list, fresh] = items_.try_emplace(key->name);
  if (fresh) list->second = reader.items(*node_, key);
  return list->second;
}

DeviceLists::DeviceLists(const ConfigNode& node) : node_(&node) {
  for (const ConfigNode& member : node.children)
    if (member.key != "n") size_ += size_of(member);
}

std::size_t DeviceLists::allowed_size() const {
  const ConfigNode* commands = node_->find("commands");
  const ConfigNode* allow = commands == nullptr ? nullptr : commands->find("allow");
  return allow == nullptr ? 0 : kBytesOfAllowed * allow->children.size();
}

DeviceEntry::DeviceEntry(const ConfigNode& node, DeviceLists* base, std::vector<std::string> n)
    : own_(node), base_(base), n_(std::move(n)), members_(node) {
  if (base_ == nullptr) return;
  std::unordered_set<std::string_view> own;
  for (const ConfigNode& member : node.children) own.insert(member.key);
  for (const ConfigNode& member : base_->node().children)
    if (!own.contains(member.key)) members_.children.push_back(member);
}

DeviceOrigin DeviceEntry::origin(std::size_t i) const {
  return {&node(), base_ == nullptr ? nullptr : &base_->node(), n_.empty() ? "" : n_[i]};
}

const ConfigNode* DeviceEntry::in_file(std::string_view key) const {
  const ConfigNode* own = node().find(key);
  return own != nullptr || base_ == nullptr ? own : base_->node().find(key);
}

std::vector<const ConfigNode*> DeviceEntry::items(ConfigReader& reader, KeyRef key) {
  static const std::vector<ConfigNode> none;
  return added(reader, base_ == nullptr ? none : base_->items(reader, key),
               own_.items(reader, key));
}

// ---- templates --------------------------------------------------------------------------------

Templates::Templates(ConfigReader& reader, const ConfigNode& top) : reader_(reader) {
  const ConfigNode* list = reader.object(top, "templates");
  if (list == nullptr) return;
  for (const ConfigNode& node : list->children) {
    const auto [entry, fresh] = templates_.try_emplace(node.key, node);
    if (!fresh) {
      reader.error_at_key(
          node, "duplicate template; the first one is at " + reader.place_of(entry->second.node()));
      continue;
    }
    if (!is_name(node.key))
      reader.error_at_key(
          node, "a name is 1 to 64 of a-z, 0-9, _ and -, found \"" + shown(node.key) + "\"");
    if (const ConfigNode* nested = node.find("template"))
      reader.error_at_key(*nested, "a template cannot use another template");
    if (const ConfigNode* n = node.find("n"))
      reader.error_at_key(*n, "belongs to the device that uses the template");
    if (node.kind != Kind::object) reader.error(node, "must be an object with keys of a device");
  }
}

DeviceLists* Templates::template_of(const ConfigNode& node, const ConfigNode& given) {
  const auto name = reader_.name(node, "devices[].template");
  if (!name) return nullptr;
  if (const auto found = templates_.find(*name); found != templates_.end()) {
    found->second.use();
    return found->second.node().kind == Kind::object ? &found->second : nullptr;
  }
  std::string text = "there is no template \"" + *name + "\"";
  if (templates_.empty()) {
    text += "; the config has no templates";
  } else if (reader_.may_suggest(given.offset)) {
    const auto names = std::views::keys(templates_);
    text += did_you_mean(*name, std::vector<std::string_view>(names.begin(), names.end()));
  }
  reader_.error(given, std::move(text));
  return nullptr;
}

std::optional<std::vector<std::string>> Templates::read_n(const ConfigNode& given,
                                                          const ConfigNode& node) {
  if (given.kind == Kind::string) {
    const auto text = reader_.text(given);
    if (!text) return std::nullopt;
    auto list = numbers_of_range(*text);
    if (list) return *std::move(list);
    reader_.error(given, list.error());
    return std::nullopt;
  }
  if (given.kind != Kind::array) {
    reader_.error(given, std::string(kWanted));
    return std::nullopt;
  }
  std::vector<std::string> list;
  bool good = true;
  for (const ConfigNode& item : reader_.items(node, "devices[].n")) {
    const std::string text =
        item.kind == Kind::integer ? std::to_string(item.integer) : reader_.replaced(item);
    if (!is_name(text)) {
      reader_.error(item, "must be an integer or a name of a-z, 0-9, _ and -");
      good = false;
    }
    list.push_back(text);
  }
  if (list.size() > max_devices) {
    reader_.error(given, too_many());
    good = false;
  }
  if (list.empty()) {
    reader_.error(given, "needs at least one number or name");
    good = false;
  }
  return good ? std::optional(std::move(list)) : std::nullopt;
}

/// Adds the size of the entry's devices, written out in full, to `bytes_`. False if the sum is over
/// the limit, so that templates make no more devices than a file without them could have.
bool Templates::has_room(const ConfigNode& node, const DeviceLists* base,
                         const std::vector<std::string>& n) {
  const DeviceLists own(node);
  std::uint64_t longest = kBytesOfPlace;
  for (const std::string& name : n) longest = std::max<std::uint64_t>(longest, name.size());
  // Upper bound: as if the text consisted of `{n}` from end to end.
  const std::uint64_t written = (own.size() + (base == nullptr ? 0 : base->size())) * longest;
  const std::uint64_t allowed = own.allowed_size() + (base == nullptr ? 0 : base->allowed_size());
  const std::uint64_t each = kBytesOfFilledDevice + written / kBytesOfPlace + allowed;
  const std::uint64_t count = std::max<std::size_t>(1, n.size());
  bytes_ += each * count;
  const ConfigLimits& limits = reader_.room().limits();
  if (bytes_ <= limits.written) return true;
  if (bytes_ - each * count <= limits.written)
    reader_.error(node, "without templates, the devices up to this one would be larger than " +
                            std::to_string(limits.written >> 20) + " MiB, the limit for " +
                            std::string(limits.whose));
  return false;
}

bool Templates::can_have_names(const DeviceEntry& entry) {
  const ConfigNode* name = entry.in_file("name");
  if (entry.count() < 2 || name == nullptr || name->kind != Kind::string ||
      has_place_of_n(name->text))
    return true;
  reader_.error(*name, "the name must contain {n}: " + std::to_string(entry.count()) +
                           " devices come from the entry at " + reader_.place_of(entry.node()));
  return false;
}

std::unique_ptr<DeviceEntry> Templates::entry(const ConfigNode& node) {
  DeviceLists* base = nullptr;
  std::vector<std::string> n;
  const ConfigNode* name = node.find("template");
  if (name != nullptr && (base = template_of(node, *name)) == nullptr) return nullptr;
  if (const ConfigNode* given = node.find("n")) {
    auto list = read_n(*given, node);
    if (!list) return nullptr;
    n = *std::move(list);
  }
  if ((base != nullptr || !n.empty()) && !has_room(node, base, n)) return nullptr;
  auto made = std::make_unique<DeviceEntry>(node, base, std::move(n));
  if (!can_have_names(*made)) made->keep_first();
  return made;
}

void Templates::warn_of_unused() {
  std::vector<std::string_view> options;
  for (const ProtocolInfo& protocol : catalog())
    for (const OptionSpec& option : protocol.options) options.push_back(option.key);
  for (const auto& [name, known] : templates_) {
    if (known.is_used()) continue;
    const ConfigNode& node = known.node();
    if (node.kind == Kind::object) reader_.check_object(node, "devices[]", options);
    reader_.warn(node, "no device uses this template");
  }
}

}  // namespace fxagent
