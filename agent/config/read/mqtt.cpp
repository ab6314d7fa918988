#include "agent/config/read/sections.h"

#include <algorithm>
#include <array>

#include "agent/config/keys.h"
#include "agent/config/read/host.h"
#include "agent/text/text.h"

namespace fxagent {

using std::string_view_literals::operator""sv;

tl::expected<std::string, std::string_view> normal_server(std::string_view server) {
  const bool is_tls = server.starts_with("mqtts://");
  if (!is_tls && !server.starts_with("mqtt://"))
    return tl::unexpected("must begin with mqtt:// or mqtts://"sv);
  std::string out = is_tls ? "mqtts://" : "mqtt://";
  std::string_view port = is_tls ? "8883" : "1883";
  server.remove_prefix(out.size());
  if (server.find('@') != server.npos)
    return tl::unexpected(
        "must not contain a user or a password; put them into username and password_file"sv);
  if (server.find('/') != server.npos)
    return tl::unexpected(
        "must be only scheme, host and port, as in mqtt://broker:1883; remove the / after it"sv);
  std::size_t host_end = 0;
  if (server.starts_with('[')) {
    host_end = server.find(']');
    if (host_end == server.npos || host_end == 1 ||
        server.substr(1, host_end - 1).find_first_not_of("0123456789abcdefABCDEF:.") != server.npos)
      return tl::unexpected("needs an IPv6 address in brackets, as in mqtt://[::1]:1883"sv);
    ++host_end;
  } else {
    host_end = std::min(server.find(':'), server.size());
    const std::string_view host = server.substr(0, host_end);
    if (host.empty()) return tl::unexpected("has no host"sv);
    const bool good = std::ranges::all_of(host, [](char c) {
      return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
             c == '.' || c == '-' || c == '_';
    });
    if (!good)
      return tl::unexpected("must be only scheme, host and port, as in mqtt://broker:1883"sv);
    if (const auto fault = host_fault(std::string(host)); !fault.empty())
      return tl::unexpected(fault);
  }
  out += server.substr(0, host_end);
  server.remove_prefix(host_end);
  if (!server.empty()) {
    port = server.substr(1);
    const auto number = number_from<std::uint16_t>(port);
    if (server[0] != ':' || port.size() > 5 || number.value_or(0) == 0)
      return tl::unexpected("needs a port from 1 to 65535 after the host, or none"sv);
  }
  return out + ":" + std::string(port);
}

bool is_on_this_machine(std::string_view server) {
  server.remove_prefix(server.find("://") + 3);
  return server.starts_with("127.") || server.starts_with("localhost:") ||
         server.starts_with("[::1]:");
}

namespace {

void read_tls(ConfigReader& reader, const ConfigNode& node, MqttConfig& mqtt) {
  TlsSettings tls;
  tls.ca_file = reader.text(node, "mqtt.tls.ca_file").value_or("");
  tls.cert_file = reader.text(node, "mqtt.tls.cert_file").value_or("");
  tls.key_file = reader.text(node, "mqtt.tls.key_file").value_or("");
  if ((node.find("cert_file") == nullptr) != (node.find("key_file") == nullptr))
    reader.error(node, "needs both cert_file and key_file, or neither");
  const bool encrypted = std::ranges::any_of(
      mqtt.servers, [](const std::string& server) { return server.starts_with("mqtts://"); });
  if (!encrypted) reader.warn(node, "has no effect: no server is mqtts://");
  mqtt.tls = tls;
}

void read_password(ConfigReader& reader, const ConfigNode& node, MqttConfig& mqtt,
                   FilePrivacy privacy) {
  mqtt.password_file = reader.text(node, "mqtt.password_file").value_or("");
  mqtt.password_env = reader.text(node, "mqtt.password_env").value_or("");
  const bool is_allowed = reader.boolean(node, "mqtt.allow_plain_secret");
  if (const auto secret = reader.secret(node, "mqtt.password")) {
    const ConfigNode& at = *node.find("password");
    mqtt.password = secret->value;
    if (node.find("password_file") != nullptr || node.find("password_env") != nullptr)
      reader.error(
          at, "password_file or password_env already names the password: use only one of them");
    else if (secret->in_clear && privacy == FilePrivacy::shared && !is_allowed)
      reader.error(
          at,
          "a plain-text password in a file that others can read: put it into password_file or "
          "password_env, or make this file private (chmod 600), or set allow_plain_secret");
    else if (secret->in_clear && privacy == FilePrivacy::shared)
      reader.warn(at, "others can read this file and its password");
  }
  constexpr std::array sources{"password_file"sv, "password_env"sv, "password"sv};
  for (const auto key : sources) {
    const ConfigNode* password = node.find(key);
    if (password == nullptr) continue;
    if (mqtt.version == 4 && node.find("username") == nullptr)
      reader.error(*password, "MQTT 3.1.1 has no password without a username: set username");
    for (const std::string& server : mqtt.servers)
      if (server.starts_with("mqtt://") && !is_on_this_machine(server))
        reader.warn(*password, "it is sent to " + server + " unencrypted; mqtts:// encrypts it");
  }
}

/// Returns the rule of the key table, "fx-{id}", with the id filled in.
std::string default_client_id(const std::string& id) {
  std::string text(std::get<ConfigKey::Rule>(config_key("mqtt.client_id").fallback).text);
  constexpr std::string_view place = "{id}";
  return text.replace(text.find(place), place.size(), id);
}

/// Reads the keys that `mqtt` and each of the `brokers` have. `tls_key` is that of their TLS.
MqttConfig read_broker(ConfigReader& reader, const ConfigNode& node, const std::string& id,
                       FilePrivacy privacy, KeyRef tls_key) {
  MqttConfig mqtt;
  if (const ConfigNode* servers = reader.array(node, "mqtt.servers")) {
    const auto items = reader.items(node, "mqtt.servers");
    if (items.empty()) reader.error(*servers, "needs at least one server");
    for (const ConfigNode& item : items) {
      const auto text = reader.text(item);
      if (!text) continue;
      if (const auto server = normal_server(*text))
        mqtt.servers.push_back(*server);
      else
        reader.error(item, std::string(server.error()));
    }
  }
  mqtt.version = reader.choice_or_default(node, "mqtt.version") == 0 ? 5 : 4;
  mqtt.client_id = reader.text(node, "mqtt.client_id").value_or(default_client_id(id));
  mqtt.username = reader.text(node, "mqtt.username").value_or("");
  read_password(reader, node, mqtt, privacy);
  if (const ConfigNode* tls = reader.object(node, tls_key)) read_tls(reader, *tls, mqtt);
  reader.set_integer(mqtt.keep_alive, node, "mqtt.keep_alive_s");
  const ConfigNode* qos = node.find("qos");
  if (qos == nullptr || qos->number != 2)
    reader.set_integer(mqtt.qos, node, "mqtt.qos");
  else
    reader.error(*qos, "must be 0 or 1; with 1 the seq shows repeats, and 2 would only cost time");
  reader.set_integer(mqtt.reconnect_spread, node, "mqtt.reconnect_spread_s");
  return mqtt;
}

}  // namespace

void read_mqtt(ConfigReader& reader, const ConfigNode& node, Config& config, FilePrivacy privacy) {
  config.mqtt = read_broker(reader, node, config.id, privacy, "mqtt.tls");
}

void read_brokers(ConfigReader& reader, const ConfigNode& list, Config& config,
                  FilePrivacy privacy) {
  for (const ConfigNode& node : list.children) {
    if (!reader.check_object(node, "brokers[]")) continue;
    BrokerConfig broker;
    broker.name = reader.name(node, "brokers[].name").value_or("");
    if (!broker.name.empty() && broker_named(config, broker.name) != nullptr)
      reader.error(*node.find("name"), "another broker has this name");
    broker.commands = reader.boolean(node, "brokers[].commands");
    broker.mqtt = read_broker(reader, node, config.id, privacy, "brokers[].tls");
    config.brokers.push_back(std::move(broker));
  }
}

}  // namespace fxagent
