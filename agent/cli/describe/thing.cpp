#include "agent/cli/describe/documents.h"

#include <cctype>
#include <cstdint>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "agent/cli/describe/schema_parts.h"
#include "agent/cli/describe/topics.h"
#include "agent/text/sha256.h"

namespace fxagent::contract {
namespace {

/// Replaces references by the schemas, because a Thing Description has none. The `first` result in
/// a result would have no end: it is any object.
Json without_references(Json schema, const Json& all) {
  constexpr std::string_view kPrefix = "#/$defs/";
  if (schema.is_object() && schema.contains("$ref")) {
    Json whole = all.at(schema["$ref"].get<std::string>().substr(kPrefix.size()));
    if (schema.contains("description")) whole["description"] = schema["description"];
    schema = std::move(whole);
  }
  if (schema.is_object() && schema.contains("properties") && schema["properties"].contains("first"))
    schema["properties"]["first"] = one_of({{{"type", "object"}}, {{"type", "null"}}});
  if (schema.is_structured())
    for (Json& part : schema) part = without_references(std::move(part), all);
  return schema;
}

/// Returns a stable identifier of the agent, a UUID of version 8 (RFC 9562) of its base topic.
std::string id_of(const Config& config) {
  Digest digest = sha256(config.base_topic());
  digest[6] = static_cast<std::uint8_t>((digest[6] & 0x0Fu) | 0x80u);
  digest[8] = static_cast<std::uint8_t>((digest[8] & 0x3Fu) | 0x80u);
  std::string hex = to_text(ByteView(digest).first(16));
  for (const std::size_t at : {20U, 16U, 12U, 8U}) hex.insert(at, 1, '-');
  return "urn:uuid:" + hex;
}

/// Returns the topic as the path of a URI.
std::string path_of(std::string_view topic) {
  constexpr std::string_view kPlain = "-._~/";
  std::string out;
  for (const char c : topic) {
    const auto byte = static_cast<std::uint8_t>(c);
    const bool is_letter_or_digit = std::isalnum(byte) != 0;
    if (is_letter_or_digit || kPlain.find(c) != kPlain.npos)
      out += c;
    else
      out += "%" + to_text(ByteView(&byte, 1));
  }
  return out;
}

Json security_of(const MqttConfig& mqtt) {
  if (!mqtt.username.empty()) return {{"scheme", "basic"}, {"in", "auto"}};
  if (mqtt.tls && !mqtt.tls->cert_file.empty()) return {{"scheme", "auto"}};
  return {{"scheme", "nosec"}};
}

/// Returns the value's schema with its unit, which a Thing Description has a key for.
Json with_unit(const TagConfig& tag, Use use) {
  Json schema = value_schema(tag, use);
  if (!tag.units->description.empty())
    schema["description"] = tag.units->description;
  else
    schema.erase("description");
  if (!tag.units->unit.empty()) schema["unit"] = tag.units->unit;
  return schema;
}

class ThingMaker {
 public:
  explicit ThingMaker(const Config& config) : config_(config), schemas_(payload_schemas()) {}

  void add(const Place& place) {
    const std::string name = place.address.substr(config_.base_topic().size() + 1);
    const Topic& topic = *place.topic;
    if (topic.name == "sample") {
      add_tags(place);
    } else if (topic.sender == Sender::client) {
      add_action(place, name);
      if (topic.name == "command") add_writes(place);
    } else if (topic.retain == Retain::yes) {
      add_retained(place, name);
    } else {
      add_event(place, name);
    }
  }

  Json properties = Json::object();
  Json actions = Json::object();
  Json events = Json::object();

 private:
  /// Returns a form for each broker. The topic is also the path of the address, because Eclipse's
  /// node-wot reads it there.
  Json forms(const Place& place, std::initializer_list<const char*> ops) const {
    const bool subscribes = place.topic->sender == Sender::agent;
    const int qos = place.topic->quality == Quality::as_configured ? config_.mqtt.qos : 1;
    Json out = Json::array();
    for (const std::string& server : config_.mqtt.servers) {
      Json form{
          {"href", server + "/" + path_of(place.address)}, {"contentType", kJsonType}, {"op", ops}};
      form[subscribes ? "mqv:filter" : "mqv:topic"] = place.address;
      form["mqv:qos"] = std::to_string(qos);
      if (place.topic->retain == Retain::yes) form["mqv:retain"] = true;
      out.push_back(std::move(form));
    }
    return out;
  }

  Json any(const std::string& schema) const {
    return without_references(reference(schema), schemas_);
  }

  void add_retained(const Place& place, const std::string& name) {
    Json out = any(std::string(place.topic->schema));
    out["description"] = place.topic->summary;
    out["readOnly"] = true;
    out["observable"] = true;
    out["forms"] = forms(place, {"readproperty", "observeproperty", "unobserveproperty"});
    append(properties, name, std::move(out));
  }

  void add_event(const Place& place, const std::string& name) {
    append(events, name,
           {{"description", place.topic->summary},
            {"data", any(std::string(place.topic->schema))},
            {"forms", forms(place, {"subscribeevent", "unsubscribeevent"})}});
  }

  void add_tags(const Place& place) {
    const Json& any_sample = schemas_["sample"];
    for (const TagConfig& tag : place.device->tags) {
      if (&place.device->groups.at(tag.group) != place.group) continue;
      const std::string name(tag.name);
      Json out{{"title", place.device->name + " " + name},
               {"description", "Samples of the group. The value is values." + name},
               {"type", "object"},
               {"readOnly", true},
               {"observable", true},
               {"required", {"ts", "values"}}};
      out["properties"]["ts"] = any_sample["properties"]["ts"];
      out["properties"]["values"] = {{"type", "object"},
                                     {"properties", {{name, with_unit(tag, Use::sample)}}}};
      out["forms"] = forms(place, {"observeproperty", "unobserveproperty"});
      append(properties, place.device->name + "." + name, std::move(out));
    }
  }

  void add_action(const Place& place, const std::string& name) {
    append(actions, name,
           {{"description", place.topic->summary},
            {"input", any(std::string(place.topic->schema))},
            {"forms", forms(place, {"invokeaction"})}});
  }

  /// Adds an action for each writable tag.
  void add_writes(const Place& place) {
    const Json& keys = schemas_[command_schema_name(Op::write)]["properties"];
    for (const TagConfig& tag : place.device->tags) {
      if (!tag.writable) continue;
      const std::string name(tag.name);
      Json input{{"type", "object"}, {"required", {"id", "op", "tag", "value"}}};
      for (const char* key : {"id", "op", "expires", "verify", "dry_run", "by"})
        input["properties"][key] = keys[key];
      input["properties"]["tag"] = constant(name);
      input["properties"]["value"] = with_unit(tag, Use::command);
      // The same id twice carries out one command.
      append(actions, place.device->name + "." + name,
             {{"title", place.device->name + " " + name},
              {"description",
               "Writes the tag. The result is the event " + place.device->name + "/result"},
              {"input", without_references(std::move(input), schemas_)},
              {"safe", false},
              {"idempotent", true},
              {"forms", forms(place, {"invokeaction"})}});
    }
  }

  const Config& config_;
  Json schemas_;
};

}  // namespace

Json thing(const Config& config, std::string_view version) {
  ThingMaker maker(config);
  for (const Place& place : places(config)) maker.add(place);
  return {{"@context",
           {"https://www.w3.org/2022/wot/td/v1.1", {{"mqv", "https://www.w3.org/2019/wot/mqtt#"}}}},
          {"@type", "Thing"},
          {"id", id_of(config)},
          {"title", "fxagent " + config.base_topic()},
          {"version", {{"instance", config.hash}, {"model", version}}},
          {"securityDefinitions", {{"broker", security_of(config.mqtt)}}},
          {"security", "broker"},
          {"properties", std::move(maker.properties)},
          {"actions", std::move(maker.actions)},
          {"events", std::move(maker.events)}};
}

}  // namespace fxagent::contract
