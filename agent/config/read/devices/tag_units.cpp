#include "agent/config/read/sections.h"

#include <map>
#include <string>
#include <string_view>

#include "agent/config/keys.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

/// Returns a text that may be empty, as generated files often have it.
std::string text_or_nothing(ConfigReader& reader, const ConfigNode& tag, std::string_view key) {
  const ConfigNode* node = tag.find(key);
  if (node == nullptr || (node->kind == ConfigNode::Kind::string && node->text.empty())) return {};
  return reader.text(*node).value_or("");
}

/// Returns `text` as a whole number, spelled as in JSON; nullopt for any other text.
std::optional<std::int64_t> whole_number(std::string_view text) {
  const auto number = number_from<std::int64_t>(text);
  return number && std::to_string(*number) == text ? number : std::nullopt;
}

TagStates read_states(ConfigReader& reader, const ConfigNode& tag, DataType type) {
  const ConfigNode* node = reader.object(tag, "devices[].tags[].states");
  if (node == nullptr) return {};
  std::map<std::int64_t, std::string> states;
  for (const ConfigNode& member : node->children) {
    const auto value = whole_number(member.key);
    const auto label = reader.text(member);
    if (!value || (type == DataType::boolean && *value != 0 && *value != 1))
      reader.error_at_key(
          member,
          std::string(type == DataType::boolean
                          ? "the states of a bool are \"0\" and \"1\""
                          : "the key of a state must be a whole number, as in {\"0\": \"idle\"}") +
              ", found \"" + shown(member.key) + "\"");
    else if (label && !states.emplace(*value, *label).second)
      reader.error_at_key(member, "is a duplicate");
  }
  return {states.begin(), states.end()};
}

TagLimits read_limits(ConfigReader& reader, const ConfigNode& tag) {
  TagLimits limits;
  limits.min = reader.number(tag, "devices[].tags[].min");
  limits.max = reader.number(tag, "devices[].tags[].max");
  limits.deadband = reader.number(tag, "devices[].tags[].deadband");
  if (limits.min && limits.max && *limits.min > *limits.max)
    reader.error(*tag.find("min"), "must not be greater than max");
  if (limits.deadband && *limits.deadband < 0)
    reader.error(*tag.find("deadband"), "must not be negative");
  return limits;
}

}  // namespace

TagUnits read_tag_units(ConfigReader& reader, const ConfigNode& tag, DataType type) {
  TagUnits units;
  units.unit = text_or_nothing(reader, tag, "unit");
  units.description = text_or_nothing(reader, tag, "description");
  units.states = read_states(reader, tag, type);
  units.limits = read_limits(reader, tag);
  const bool is_number = type != DataType::boolean && type != DataType::string;
  for (const auto key : {"scale"sv, "offset"sv, "min"sv, "max"sv, "deadband"sv})
    if (const ConfigNode* given = tag.find(key); given != nullptr && !is_number)
      reader.error_at_key(*given, "is for numbers, not for " + std::string(to_string(type)));
  if (const ConfigNode* given = tag.find("states"); given != nullptr && type == DataType::string)
    reader.error_at_key(*given, "is for numbers and bools, not for string");
  return units;
}

}  // namespace fxagent
