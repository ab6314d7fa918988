#include "agent/config/read/reader.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <ranges>
#include <unordered_map>
#include <utility>

#include "agent/config/suggestions.h"
#include "agent/text/text.h"
#include "protocol/letter_case.h"

namespace fxagent {
namespace {

using Kind = ConfigNode::Kind;

/// Most suggestions per text. Users do not read more.
constexpr int kMostSuggestions = 20;

bool is_name_start(char c) { return c == '_' || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z'); }
bool is_name_part(char c) { return is_name_start(c) || (c >= '0' && c <= '9'); }

std::string found_text(const ConfigNode& node) {
  switch (node.kind) {
    case Kind::null:
      return "null";
    case Kind::boolean:
      return node.boolean ? "true" : "false";
    case Kind::integer:
      return "the number " + std::to_string(node.integer);
    case Kind::number:
      return "the number " + shown(node.text);
    case Kind::string:
      return "the string \"" + shown(node.text) + "\"";
    case Kind::array:
      return "an array";
    case Kind::object:
      return "an object";
  }
  return {};
}

/// Placeholder that the key `n` of a device replaces.
constexpr std::string_view kPlaceOfN = "{n}";

/// Returns the position of the first placeholder at or after `from`; npos if there is none.
std::size_t place_of_n(std::string_view text, std::size_t from = 0) {
  while ((from = text.find(kPlaceOfN, from)) != std::string_view::npos) {
    if (from == 0 || text[from - 1] != '$') return from;
    from += kPlaceOfN.size();
  }
  return from;
}

}  // namespace

bool has_place_of_n(std::string_view text) { return place_of_n(text) != std::string_view::npos; }

std::string with_n(std::string_view text, std::string_view n) {
  std::string out;
  std::size_t from = 0;
  for (std::size_t at = 0; (at = place_of_n(text, from)) != std::string_view::npos;
       from = at + kPlaceOfN.size())
    out.append(text.substr(from, at - from)).append(n);
  return out.append(text.substr(from));
}

ConfigReader::ConfigReader(const ConfigTree& tree, Environment environment,
                           const ReadBounds& bounds)
    : tree_(tree), environment_(std::move(environment)), bounds_(bounds), room_(bounds.limits) {}

void ConfigReader::set_origin(const DeviceOrigin* origin) {
  origin_ = origin;
  ++device_;
}

void ConfigReader::error(const ConfigNode& at, std::string text) {
  errors_.add(at.offset, at, without_secrets(at, std::move(text)), origin_, device_);
}

void ConfigReader::error_at_key(const ConfigNode& at, std::string text) {
  errors_.add(at.key_offset, at, without_secrets(at, std::move(text)), origin_, device_);
}

void ConfigReader::warn(const ConfigNode& at, std::string text) {
  warnings_.add(at.offset, at, without_secrets(at, std::move(text)), origin_, device_);
}

bool ConfigReader::may_suggest(std::uint32_t offset) {
  return !errors_.knows(offset, origin_) && ++suggestions_ <= kMostSuggestions;
}

bool ConfigReader::has_room(const ConfigNode& at, const ConfigSize& more) {
  if (room_.is_full()) return false;
  std::string fault = room_.add(more);
  if (fault.empty()) return true;
  error(at, std::move(fault));
  return false;
}

std::vector<std::string> ConfigReader::warnings() const {
  std::vector<std::string> list;
  for (const ConfigError& warning : warnings_.in_order(tree_))
    list.push_back(warning.line == 0
                       ? warning.text
                       : place_text(warning.pointer, warning.line) + ": " + warning.text);
  return list;
}

bool ConfigReader::check_object(const ConfigNode& node, std::string_view section,
                                std::span<const std::string_view> more,
                                std::span<const std::string_view> left_to_caller) {
  if (node.kind != Kind::object) {
    wrong_kind(node, "an object");
    return false;
  }
  const std::span<const ConfigKey> keys = config_section(section);
  std::unordered_map<std::string_view, const ConfigNode*> seen;
  for (const ConfigNode& child : node.children) {
    const auto [first, fresh] = seen.emplace(child.key, &child);
    if (!fresh) {
      error_at_key(child, "duplicate key; the first one is in line " +
                              std::to_string(tree_.line_of(first->second->key_offset)));
      continue;
    }
    if (contains(keys, child.key, &ConfigKey::name) || contains(more, child.key) ||
        contains(left_to_caller, child.key))
      continue;
    std::string text = "unknown key \"" + shown(child.key) + "\"";
    if (may_suggest(child.key_offset)) {
      auto known = names_in(keys);
      known.insert(known.end(), more.begin(), more.end());
      text += cure_of_key(child.key, section, known);
    }
    error_at_key(child, std::move(text));
  }
  return true;
}

const ConfigNode* ConfigReader::member(const ConfigNode& parent, KeyRef key) {
  const ConfigNode* node = parent.find(key->name);
  if (node == nullptr && key->is_required())
    error(parent, "\"" + std::string(key->name) + "\" is missing");
  return node;
}

void ConfigReader::wrong_kind(const ConfigNode& node, std::string_view wanted) {
  error(node, "must be " + std::string(wanted) + ", found " + found_text(node));
}

const ConfigNode* ConfigReader::object(const ConfigNode& parent, KeyRef key) {
  const ConfigNode* node = member(parent, key);
  if (node == nullptr) return nullptr;
  const std::string parent_path = key->section.empty() ? "" : std::string(key->section) + ".";
  const std::string section = parent_path + std::string(key->name);
  // The keys of templates and states are names that the user chooses.
  if (node->kind == Kind::object && config_section(section).empty()) return node;
  return check_object(*node, section) ? node : nullptr;
}

const ConfigNode* ConfigReader::array(const ConfigNode& parent, KeyRef key) {
  const ConfigNode* node = member(parent, key);
  if (node == nullptr || node->kind == Kind::array) return node;
  wrong_kind(*node, "an array");
  return nullptr;
}

std::vector<ConfigNode> ConfigReader::items(const ConfigNode& parent, KeyRef key) {
  const ConfigNode* node = array(parent, key);
  return node == nullptr ? std::vector<ConfigNode>() : tree_.items_of(*node);
}

std::optional<std::int64_t> ConfigReader::integer(const ConfigNode& parent, KeyRef key) {
  const ConfigNode* node = member(parent, key);
  if (node == nullptr) return std::nullopt;
  // JSON Schema treats 5.0 as the integer 5, so we do too. Every range is within the integers that
  // a double represents exactly.
  constexpr double kExact = 9007199254740992.0;
  const auto number = number_in(*node);
  std::optional<std::int64_t> value;
  if (node->kind == Kind::integer)
    value = node->integer;
  else if (number && std::abs(*number) <= kExact && *number == std::trunc(*number))
    value = static_cast<std::int64_t>(*number);
  if (value && *value >= key->limits.min && *value <= key->limits.max) return value;
  wrong_kind(*node, "an integer from " + std::to_string(key->limits.min) + " to " +
                        std::to_string(key->limits.max));
  return std::nullopt;
}

std::optional<double> ConfigReader::number(const ConfigNode& parent, KeyRef key) {
  const ConfigNode* node = member(parent, key);
  if (node == nullptr) return std::nullopt;
  if (const auto value = number_in(*node)) return value;
  wrong_kind(*node, "a number");
  return std::nullopt;
}

bool ConfigReader::boolean(const ConfigNode& parent, KeyRef key) {
  const ConfigNode* node = member(parent, key);
  if (node == nullptr) return key->flag();
  if (node->kind == Kind::boolean) return node->boolean;
  wrong_kind(*node, "true or false");
  return key->flag();
}

std::optional<std::string> ConfigReader::text(const ConfigNode& node) {
  if (node.kind != Kind::string) {
    wrong_kind(node, "a string");
    return std::nullopt;
  }
  auto value = expand(spelled(node));
  if (origin_ != nullptr && origin_->n.empty() && has_place_of_n(node.text))
    error(node, "{n} has no value: the device has no \"n\"");
  else if (!value)
    error(node, std::move(value.error()));
  else if (value->empty())
    error(node,
          "must not be empty" + (node.text.empty() ? "" : ", \"" + shown(node.text) + "\" is"));
  else if (std::ranges::any_of(*value, is_control))
    error(node, "must not have control characters");
  else
    return *std::move(value);
  return std::nullopt;
}

std::optional<std::string> ConfigReader::text(const ConfigNode& parent, KeyRef key) {
  const ConfigNode* node = member(parent, key);
  return node == nullptr ? std::nullopt : text(*node);
}

std::optional<ConfigReader::Secret> ConfigReader::secret(const ConfigNode& parent, KeyRef key) {
  const ConfigNode* node = member(parent, key);
  if (node == nullptr) return std::nullopt;
  if (node->kind != Kind::string) {
    error(*node, "must be a string");
    return std::nullopt;
  }
  const std::string_view text = node->text;
  const bool is_variable = text.starts_with("${") && text.find('}') == text.size() - 1;
  auto value = expand(text);
  if (!value)
    error(*node, is_variable ? value.error()
                             : "\"${\" must begin the name of an environment variable that is set; "
                               "for a literal \"${\" write \"$${\"");
  else if (value->empty())
    error(*node, "must not be empty");
  else if (std::ranges::any_of(*value, is_control))
    error(*node, "must not have control characters");
  else
    return Secret{*std::move(value), !is_variable};
  return std::nullopt;
}

std::optional<std::string> ConfigReader::name(const ConfigNode& parent, KeyRef key) {
  auto value = text(parent, key);
  if (!value || is_name(*value)) return value;
  const ConfigNode& node = *parent.find(key->name);
  error(node, "a name is 1 to 64 of a-z, 0-9, _ and -, found \"" + shown(node.text) + "\"" +
                  (has_place_of_n(*value) ? "; only the key \"n\" of a device replaces {n}" : ""));
  return std::nullopt;
}

std::optional<std::size_t> ConfigReader::choice(const ConfigNode& parent, KeyRef key) {
  const auto value = text(parent, key);
  if (!value) return std::nullopt;
  const auto words = key->limits.words;
  const auto found = std::ranges::find(words, *value);
  if (found != words.end()) return static_cast<std::size_t>(found - words.begin());
  const ConfigNode& node = *parent.find(key->name);
  error(node, "must be " + one_of(words) + ", found \"" + shown(node.text) + "\"" +
                  (may_suggest(node.offset) ? did_you_mean(node.text, words) : std::string()));
  return std::nullopt;
}

std::string ConfigReader::spelled(const ConfigNode& node) const {
  return origin_ != nullptr && !origin_->n.empty() ? with_n(node.text, origin_->n) : node.text;
}

std::string ConfigReader::replaced(const ConfigNode& node) const {
  if (node.kind != Kind::string) return {};
  return expand(spelled(node)).value_or("");
}

std::optional<double> ConfigReader::number_in(const ConfigNode& node) const {
  if (node.kind == Kind::integer || node.kind == Kind::number) return node.number;
  if (node.kind != Kind::string || node.text != kPlaceOfN || origin_ == nullptr)
    return std::nullopt;
  const auto number = number_from<std::int64_t>(origin_->n);
  return number ? std::optional(static_cast<double>(*number)) : std::nullopt;
}

tl::expected<std::string, std::string> ConfigReader::expand(std::string_view text) const {
  std::string out;
  while (true) {
    const std::size_t start = text.find("${");
    out += text.substr(0, start);
    if (start == std::string_view::npos) return out;
    if (start > 0 && text[start - 1] == '$') {  // $${NAME} stands for a plain ${NAME}
      out += "{";
      text.remove_prefix(start + 2);
      continue;
    }
    text.remove_prefix(start + 2);
    const std::size_t end = text.find('}');
    const std::string_view variable = text.substr(0, end);
    if (end == std::string_view::npos || variable.empty() || !is_name_start(variable[0]) ||
        !std::ranges::all_of(variable, is_name_part))
      return tl::unexpected(
          std::string("\"${\" must begin the name of an environment variable, as in ${NAME}; for a "
                      "literal \"${\" write \"$${\""));
    const auto value = environment_(variable);
    if (!value)
      return tl::unexpected("the environment variable " + shown(variable) + " is not set");
    out += *value;
    text.remove_prefix(end + 1);
  }
}

std::string ConfigReader::without_secrets(const ConfigNode& at, std::string text) const {
  if (at.kind != Kind::string || at.text.find("${") == std::string::npos) return text;
  const std::string in_file = spelled(at);
  const auto expanded = expand(in_file);
  if (!expanded || expanded->empty() || *expanded == in_file) return text;
  // A protocol may quote an address in capitals.
  const auto same = [](char a, char b) { return lower(a) == lower(b); };
  std::string out;
  auto from = text.cbegin();
  while (true) {
    const auto found = std::search(from, text.cend(), expanded->begin(), expanded->end(), same);
    out.append(from, found);
    if (found == text.cend()) return out;
    out += in_file;
    from = found + static_cast<std::ptrdiff_t>(expanded->size());
  }
}

void NameTable::add(ConfigReader& reader, const std::string& name, const ConfigNode& node,
                    std::uint32_t index) {
  const auto [entry, fresh] = entries_.emplace(name, Entry{index, &node});
  if (fresh) return;
  if (entry->second.is_guess)
    entry->second = {index, &node};
  else
    reader.error(node, "\"" + name + "\" is already used as a name at " +
                           reader.place_of(*entry->second.node));
}

std::string NameTable::read(ConfigReader& reader, const ConfigNode& item, KeyRef key,
                            std::uint32_t index) {
  const ConfigNode* node = item.find(key->name);
  if (const auto name = reader.name(item, key)) {
    add(reader, *name, *node, index);
    return *name;
  }
  // "Line1" is reported here, and not once more at each "line1" that refers to it.
  const std::string meant = node == nullptr ? "" : lower(node->text);
  if (is_name(meant))
    entries_.try_emplace(meant, Entry{index, node, true});
  else
    add_unnamed();
  return {};
}

std::optional<std::uint32_t> NameTable::find(std::string_view name) const {
  const auto entry = entries_.find(name);
  return entry == entries_.end() ? std::nullopt : std::optional(entry->second.index);
}

void NameTable::report_unknown(ConfigReader& reader, const ConfigNode& at, std::string_view what,
                               std::string_view name, std::string_view none) const {
  if (has_unnamed_) return;
  std::string text = std::string(what) + " \"" + std::string(name) + "\"";
  if (entries_.empty()) {
    text += none;
  } else if (reader.may_suggest(at.offset)) {
    const auto names = std::views::keys(entries_);
    text += in_place_of(name, std::vector<std::string_view>(names.begin(), names.end()));
  }
  reader.error(at, std::move(text));
}

}  // namespace fxagent
