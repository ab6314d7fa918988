#include "agent/cli/describe/documents.h"

#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "agent/cli/describe/payload_schema.h"
#include "agent/cli/describe/schema_parts.h"
#include "agent/cli/describe/topics.h"
#include "agent/text/json.h"
#include "agent/uplink/payload/json_payload.h"

namespace fxagent::contract {
namespace {

Json all_of(Json one, Json other) { return {{"allOf", {std::move(one), std::move(other)}}}; }

Json of_topic(const Topic& topic, const std::string& schema) {
  Json out{{"description", topic.summary}};
  out.update(reference(schema));
  return out;
}

// ---- one device ---------------------------------------------------------------------------------

/// Accepts samples in which `tag` is in `values` or in `bad`, and not in both.
Json in_one_place(const TagConfig& tag) {
  const Json names{{"required", {std::string(tag.name)}}};
  return one_of({{{"properties", {{"values", names}}}},
                 {{"required", {"bad"}}, {"properties", {{"bad", names}}}}});
}

Json sample_of(const DeviceConfig& device, std::uint32_t group, const std::string& meta) {
  Json names = Json::array();
  Json values = Json::object();
  Json places = Json::array();
  for (const TagConfig& tag : device.tags) {
    if (tag.group != group) continue;
    names.push_back(std::string(tag.name));
    values[std::string(tag.name)] = value_schema(tag, Use::sample);
    places.push_back(in_one_place(tag));
  }
  const Json one_name{{"enum", std::move(names)}};
  Json own{{"properties",
            {{"meta", constant(meta)},
             {"values", {{"properties", std::move(values)}, {"additionalProperties", false}}},
             {"bad", {{"propertyNames", one_name}}},
             {"written", {{"items", one_name}}}}}};
  own["if"] = {{"required", {"partial"}}};
  own["then"] = true;
  own["else"] = {{"allOf", std::move(places)}};
  return all_of(reference("sample"), std::move(own));
}

/// Rows of an earlier config have another meta and other tags.
Json history_of(const std::string& sample, const std::string& meta) {
  const Json row{{"if", {{"properties", {{"meta", constant(meta)}}}}}, {"then", reference(sample)}};
  return all_of(reference("history"), {{"properties", {{"rows", {{"items", row}}}}}});
}

Json meta_of(const DeviceConfig& device, const std::string& hash) {
  Json tags = Json::object();
  Json names = Json::array();
  for (const TagConfig& tag : device.tags) names.push_back(std::string(tag.name));
  if (!names.empty()) tags["required"] = std::move(names);
  tags["maxProperties"] = device.tags.size();
  return all_of(reference("meta"), {{"properties", {{"hash", constant(hash)}, {"tags", tags}}}});
}

/// True if a command of this kind may name the tag.
bool takes(Op op, const TagConfig& tag) {
  if (op == Op::read) return true;
  if (!tag.writable) return false;
  return op == Op::write || (tag.point.type == DataType::boolean && !tag.point.is_array);
}

/// Accepts targets by address, and by the tags that `op` takes. With a write the value must fit.
Json targets_of(const DeviceConfig& device, Op op) {
  Json choices = Json::array();
  choices.push_back({{"properties", {{"tag", {{"type", "null"}}}}}});
  Json names = Json::array();
  for (const TagConfig& tag : device.tags) {
    if (!takes(op, tag)) continue;
    const std::string name(tag.name);
    names.push_back(name);
    if (op == Op::write)
      choices.push_back(
          {{"required", {"tag"}},
           {"properties", {{"tag", constant(name)}, {"value", value_schema(tag, Use::command)}}}});
  }
  if (op != Op::write && !names.empty())
    choices.push_back({{"required", {"tag"}}, {"properties", {{"tag", {{"enum", names}}}}}});
  Json out{{"oneOf", std::move(choices)}};
  if (device.commands.allow.empty()) out["properties"] = {{"address", {{"type", "null"}}}};
  return out;
}

/// True if the agent may accept such a command for the device.
bool accepts(const DeviceConfig& device, Op op) {
  if (op == Op::run || op == Op::stop)
    return device.commands.allow_run_stop && device.codec->plc() != nullptr;
  if (!device.commands.allow.empty()) return op != Op::read || !device.codec->is_broadcast();
  for (const TagConfig& tag : device.tags)
    if (takes(op, tag)) return true;
  return false;
}

void add_commands_of(const DeviceConfig& device, Json& out) {
  Json::array_t choices;
  for (const Op op : kOps) {
    if (!accepts(device, op)) continue;
    const std::string any = command_schema_name(op);
    if (op == Op::run || op == Op::stop) {
      choices.push_back(reference(any));
      continue;
    }
    const std::string targets = schema_name(device, any + "_target");
    append(out, targets, targets_of(device, op));
    Json own{{"allOf", {reference(any), reference(targets)}}};
    if (op != Op::read) own["properties"] = {{"targets", {{"items", reference(targets)}}}};
    const std::string name = schema_name(device, any);
    append(out, name, std::move(own));
    choices.push_back(reference(name));
  }
  // A device that takes no commands.
  append(out, schema_name(device, "command"),
         choices.empty() ? never() : one_of(std::move(choices)));
}

void add_device(const DeviceConfig& device, Json& out) {
  const std::string hash = json::device_meta(device).hash;
  append(out, schema_name(device, "meta"), meta_of(device, hash));
  for (const std::uint32_t index : used_groups(device)) {
    const GroupConfig& group = device.groups.at(index);
    const std::string sample = schema_name(device, "sample", &group);
    append(out, sample, sample_of(device, index, hash));
    append(out, schema_name(device, "history", &group), history_of(sample, hash));
  }
  add_commands_of(device, out);
}

/// Narrows health to the links and devices of the config.
Json health_of(const Config& config, Json health) {
  const auto narrow = [&health](const char* part, const auto& all) {
    Json names = Json::array();
    for (const auto& each : all) names.push_back(each.name);
    Json& map = health["properties"][part];
    if (names.empty()) return;
    map["required"] = names;
    map["propertyNames"] = {{"enum", std::move(names)}};
  };
  narrow("links", config.links);
  narrow("devices", config.devices);
  return health;
}

}  // namespace

Json schemas_of(const Config& config) {
  Json out = payload_schemas();
  out["health"] = health_of(config, std::move(out["health"]));
  for (const DeviceConfig& device : config.devices) add_device(device, out);
  return out;
}

Json payload_page() { return parsed_ordered_json(kPayloadSchema); }

Json payload_schemas() { return payload_page()["$defs"]; }

Json payload_page(const Config& config) {
  Json out = payload_page();
  out["title"] = "Payloads of " + config.base_topic();
  Json& topics = out["properties"] = Json::object();
  for (const Place& place : places(config))
    append(topics, place.address, of_topic(*place.topic, place.schema));
  out["$defs"] = schemas_of(config);
  return out;
}

}  // namespace fxagent::contract
