#include "agent/cli/describe/documents.h"

#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>

#include "agent/cli/describe/schema_parts.h"
#include "agent/cli/describe/topics.h"

namespace fxagent::contract {
namespace {

constexpr std::string_view kBinding = "0.2.0";

Json pointer(const std::string& place) { return {{"$ref", "#/" + place}}; }

/// Moves the references of schemas to the place that AsyncAPI has for them.
void move_references(Json& schema) {
  constexpr std::string_view kFrom = "#/$defs/";
  if (schema.is_object())
    if (const auto found = schema.find("$ref"); found != schema.end())
      *found = "#/components/schemas/" + found->get<std::string>().substr(kFrom.size());
  if (schema.is_structured())
    for (Json& part : schema) move_references(part);
}

Json servers_of(const MqttConfig& mqtt, bool has_login) {
  Json out = Json::object();
  for (const std::string& url : mqtt.servers) {
    const std::size_t end = url.find("://");
    const bool is_secure = url.starts_with("mqtts");
    Json server{{"host", url.substr(end + 3)},
                {"protocol", is_secure ? "secure-mqtt" : "mqtt"},
                {"protocolVersion", mqtt.version == 5 ? "5" : "3.1.1"}};
    if (has_login) server["security"] = {pointer("components/securitySchemes/login")};
    out["broker" + std::to_string(out.size() + 1)] = std::move(server);
  }
  return out;
}

/// Returns the scheme of the brokers; null if they need no login.
Json login_of(const MqttConfig& mqtt) {
  if (!mqtt.username.empty()) return {{"type", "userPassword"}};
  if (mqtt.tls && !mqtt.tls->cert_file.empty()) return {{"type", "X509"}};
  return nullptr;
}

/// Channels whose payloads have equal schemas are one channel with parameters.
class Document {
 public:
  explicit Document(const Config& config) : config_(config) {}

  void add(const Place& place) {
    const bool is_own = place.schema.find('.') != place.schema.npos;
    const std::string key = is_own ? place.schema : std::string(place.topic->name);
    if (!keys_.insert(key).second) return;
    const std::string any = config_.base_topic() + "/" + std::string(place.topic->address);
    Json channel{{"address", is_own ? place.address : any},
                 {"title", place.topic->summary},
                 {"messages", {{place.schema, pointer("components/messages/" + place.schema)}}}};
    if (!is_own && place.topic->has("{"))
      channel["parameters"] = parameters_of(place.topic->address);
    append(channels, key, std::move(channel));
    if (is_own || !messages.contains(place.schema))
      append(messages, place.schema,
             {{"name", place.schema},
              {"contentType", kJsonType},
              {"payload", pointer("components/schemas/" + place.schema)}});
    add_operation(place, key);
  }

  /// Messages of profiles have no schema: other projects define most of them.
  void add(const ProfileTopic& topic) {
    const std::string name(topic.name);
    const auto [place, is_new] = of_address_.try_emplace(topic.address, name);
    const std::string& key = place->second;
    if (is_new) {
      Json channel{{"address", topic.address}, {"title", topic.summary}};
      if (Json parameters = parameters_of(topic.address); !parameters.empty())
        channel["parameters"] = std::move(parameters);
      append(channels, key, std::move(channel));
    }
    channels[key]["messages"][name] = pointer("components/messages/" + name);
    append(messages, name, {{"name", name}, {"contentType", topic.content_type}});
    const bool sends = topic.sender == Sender::agent;
    Json out = operation(sends, key, topic.summary, topic.qos, topic.retain);
    out["messages"] = {pointer("channels/" + key + "/messages/" + name)};
    append(operations, (sends ? "send." : "receive.") + name, std::move(out));
  }

  Json channels = Json::object();
  Json messages = Json::object();
  Json operations = Json::object();

 private:
  Json parameters_of(std::string_view address) const {
    Json out = Json::object();
    for (const std::string name : {"device", "group", "tag", "link", "object"})
      if (address.find("{" + name + "}") != address.npos) out[name] = Json::object();
    if (out.contains("device"))
      for (const DeviceConfig& device : config_.devices) out["device"]["enum"] += device.name;
    if (out.contains("link"))
      for (const LinkConfig& link : config_.links)
        if (link.allow_yield) out["link"]["enum"] += link.name;
    return out;
  }

  void add_operation(const Place& place, const std::string& key) {
    const Topic& topic = *place.topic;
    const bool sends = topic.sender == Sender::agent;
    const int qos = topic.quality == Quality::as_configured ? config_.mqtt.qos : 1;
    Json out = operation(sends, key, topic.summary, qos, topic.retain);
    if (topic.name == "command") out["reply"] = reply("result");
    if (topic.name == "link_command") out["reply"] = reply("link_result");
    if (topic.name == "desired") out["reply"] = reply("reported");
    append(operations, (sends ? "send." : "receive.") + key, std::move(out));
  }

  static Json operation(bool sends, const std::string& channel, std::string_view summary, int qos,
                        Retain retain) {
    return {{"action", sends ? "send" : "receive"},
            {"channel", pointer("channels/" + channel)},
            {"summary", summary},
            {"bindings",
             {{"mqtt",
               {{"qos", qos}, {"retain", retain == Retain::yes}, {"bindingVersion", kBinding}}}}}};
  }

  static Json reply(const std::string& channel) {
    return {{"channel", pointer("channels/" + channel)}};
  }

  const Config& config_;
  std::set<std::string> keys_;                     ///< of `channels`
  std::map<std::string, std::string> of_address_;  ///< the key of a profile's channel
};

}  // namespace

Json asyncapi(const Config& config, std::string_view version) {
  Document document(config);
  for (const Place& place : places(config)) document.add(place);
  for (const ProfileTopic& topic : profile_topics(config)) document.add(topic);
  Json schemas = schemas_of(config);
  move_references(schemas);
  const Json login = login_of(config.mqtt);
  Json out{{"asyncapi", "3.0.0"},
           {"info",
            {{"title", "fxagent " + config.base_topic()},
             {"version", version},
             {"description", "What the agent sends and receives, from its config with the hash " +
                                 config.hash + "."}}},
           {"defaultContentType", kJsonType},
           {"servers", servers_of(config.mqtt, !login.is_null())},
           {"channels", std::move(document.channels)},
           {"operations", std::move(document.operations)},
           {"components",
            {{"messages", std::move(document.messages)}, {"schemas", std::move(schemas)}}}};
  if (!login.is_null()) out["components"]["securitySchemes"] = {{"login", login}};
  return out;
}

}  // namespace fxagent::contract
