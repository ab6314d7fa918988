#include "agent/cli/describe/schema_parts.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "agent/text/json.h"
#include "agent/text/json_writer.h"
#include "protocol/value/point.h"

namespace fxagent::contract {
namespace {

constexpr auto kExact = static_cast<double>(json::kMaxExactInteger);

/// Returns the number as samples have it.
Json whole(std::int64_t number) {
  if (number > json::kMaxExactInteger || number < -json::kMaxExactInteger)
    return std::to_string(number);
  return number;
}

bool is_real(DataType type) { return type == DataType::float32 || type == DataType::float64; }

Json number_schema(const TagConfig& tag, Use use) {
  const Point& point = tag.point;
  const TagLimits none;
  const TagLimits& limits = use == Use::command ? tag.units->limits : none;
  std::optional<double> least = limits.min;
  std::optional<double> greatest = limits.max;
  bool may_be_text = false;
  const auto range = is_real(point.type) ? std::nullopt : value_range(point);
  if (range) {
    may_be_text = range->least < -kExact || range->greatest > kExact;
    least = std::max({range->least, -kExact, least.value_or(range->least)});
    greatest = std::min({range->greatest, kExact, greatest.value_or(range->greatest)});
  }
  const bool is_whole = use == Use::sample && !is_real(point.type) && !point.scaled();
  Json out{{"type", is_whole ? "integer" : "number"}};
  if (least) out["minimum"] = json_number(*least);
  if (greatest) out["maximum"] = json_number(*greatest);
  if (!may_be_text) return out;
  return one_of({std::move(out), {{"type", "string"}, {"pattern", "^(0|-?[1-9][0-9]*)$"}}});
}

Json element_schema(const TagConfig& tag, Use use) {
  switch (tag.point.type) {
    case DataType::boolean:
      if (use == Use::sample) return {{"type", "boolean"}};
      return {{"enum", {true, false, 1, 0}}};
    case DataType::string: {
      Json out{{"type", "string"}, {"maxLength", tag.point.length}};
      if (use == Use::command) out["pattern"] = R"(^[\u0001-\u00ff]*$)";
      return out;
    }
    default:
      return number_schema(tag, use);
  }
}

/// Returns `element` as a choice of labelled values and of all others.
Json labelled(const TagConfig& tag, Use use, Json element) {
  const bool is_bool = tag.point.type == DataType::boolean;
  Json::array_t choices;
  Json values = Json::array();
  const TagLimits& limits = tag.units->limits;
  for (const auto& [number, label] : tag.units->states) {
    const auto value = static_cast<double>(number);
    if (use == Use::command &&
        (value < limits.min.value_or(value) || value > limits.max.value_or(value)))
      continue;
    const Json one = is_bool ? Json(number != 0) : whole(number);
    values.push_back(one);
    choices.push_back({{"const", one}, {"title", label}});
  }
  if (choices.empty()) return element;
  element["not"] = {{"enum", std::move(values)}};
  choices.push_back(std::move(element));
  return one_of(std::move(choices));
}

std::string description_of(const TagConfig& tag) {
  std::string out = tag.units->description;
  if (!tag.units->unit.empty()) out += (out.empty() ? "Unit: " : "; unit: ") + tag.units->unit;
  return out;
}

}  // namespace

Json reference(const std::string& name) { return {{"$ref", "#/$defs/" + name}}; }

Json one_of(Json::array_t schemas) { return {{"oneOf", std::move(schemas)}}; }

Json never() { return {{"not", Json::object()}}; }

Json constant(Json value) { return {{"const", std::move(value)}}; }

std::string command_schema_name(Op op) { return "command_" + std::string(to_string(op)); }

void append(Json& object, std::string key, Json value) {
  object.get_ref<Json::object_t&>().emplace_back(std::move(key), std::move(value));
}

Json value_schema(const TagConfig& tag, Use use) {
  Json schema = labelled(tag, use, element_schema(tag, use));
  if (tag.point.is_array)
    schema = {{"type", "array"},
              {"items", std::move(schema)},
              {"minItems", tag.point.count},
              {"maxItems", tag.point.count}};
  if (std::string text = description_of(tag); !text.empty())
    schema["description"] = std::move(text);
  return schema;
}

}  // namespace fxagent::contract
