#include "agent/cli/setup/init_files.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <utility>

#include "agent/cli/setup/acl.h"
#include "agent/config/json/pretty.h"
#include "agent/config/loader.h"
#include "agent/config/read/reader.h"
#include "agent/import/imported.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

constexpr std::string_view kConfig = "agent.json";
constexpr std::string_view kAcl = "fxagent.acl";
constexpr std::string_view kDropIn = "fxagent.service.d.conf";
/// A place that the service's user can read; it has no access to home directories.
constexpr std::string_view kPlace = "/etc/fxagent";
constexpr std::string_view kPassword = "mqtt_password";
constexpr std::string_view kFlow = "node-red-flow.json";

std::string list_of(const std::vector<JsonObject>& items) {
  std::string text = "[";
  for (const JsonObject& item : items) text += (text.size() > 1 ? "," : "") + item.dump();
  return text + "]";
}

std::string quoted(std::string_view text) {
  std::string out;
  append_json_string(out, text);
  return out;
}

// ---- config -----------------------------------------------------------------------------------

/// Parses "temp=D100", or "D100", which gets a name derived from it.
JsonObject tag_of(const std::string& spelled, bool is_written, NameMaker& names) {
  std::vector<ImportNote> ignored;
  const std::size_t mark = spelled.find('=');
  const std::string address = mark == spelled.npos ? spelled : spelled.substr(mark + 1);
  const std::string name =
      mark == spelled.npos ? names.make(address, "tag", 0, ignored) : spelled.substr(0, mark);
  JsonObject tag;
  tag.text("name", name);
  tag.text("address", address);
  tag.text("group", "fast");
  if (is_written) tag.text("access", "read_write");
  return tag;
}

std::string device_text(const InitAnswers& answers) {
  JsonObject device;
  device.text("name", answers.device);
  device.text("link", "line1");
  device.text("protocol", answers.protocol);
  if (!answers.model.empty()) device.text("model", answers.model);
  const ProtocolInfo* protocol = find_protocol(answers.protocol);
  for (const auto key : {"unit"sv, "station"sv})
    if (protocol != nullptr && !answers.unit.empty() &&
        std::ranges::find(protocol->options, key, &OptionSpec::key) != protocol->options.end())
      device.raw(key, answers.unit);
  device.raw("groups", R"([{"name": "fast", "interval_ms": 1000}])");
  NameMaker names;
  std::vector<JsonObject> tags;
  tags.reserve(answers.read.size() + answers.write.size());
  for (const std::string& spelled : answers.read) tags.push_back(tag_of(spelled, false, names));
  for (const std::string& spelled : answers.write) tags.push_back(tag_of(spelled, true, names));
  device.raw("tags", list_of(tags));
  return device.dump();
}

std::string config_text(const InitAnswers& answers) {
  Imported links;
  LinkTable(links).to(answers.port);
  JsonObject agent;
  agent.text("id", answers.id);
  JsonObject mqtt;
  // std::quoted would match, too.
  mqtt.raw("servers", "[" + fxagent::quoted(answers.broker) + "]");
  if (!answers.user.empty()) mqtt.text("username", answers.user);
  if (!answers.password_file.empty()) mqtt.text("password_file", answers.password_file);
  JsonObject out;
  out.raw("agent", agent.dump());
  out.raw("mqtt", mqtt.dump());
  out.raw("store", R"({"path": "/var/lib/fxagent"})");
  out.raw("links", list_of(links.links));
  out.raw("devices", "[" + device_text(answers) + "]");
  return pretty_text(out.dump());
}

// ---- unit drop-in -----------------------------------------------------------------------------

std::string drop_in_text(const InitAnswers& answers, const std::string& directory) {
  const std::string config = "/" + std::string(kConfig);
  const std::string place = std::string(kPlace) + config;
  std::string text = "# Additions to fxagent.service for this plant. Install it with:\n";
  if (directory != kPlace)
    text += "#   install -D -m 644 " + directory + config + " " + place + "\n";
  text += "#   install -D -m 644 " + directory + "/" + std::string(kDropIn) +
          " /etc/systemd/system/fxagent.service.d/plant.conf\n"
          "#   systemctl daemon-reload\n"
          "[Service]\n"
          "ExecStart=\n"
          "ExecStart=/usr/bin/fxagent run " +
          place + "\n";
  const bool is_known =
      std::ranges::any_of(std::array{"/dev/tty"sv, "/dev/rfcomm"sv, "/dev/serial/"sv},
                          [&](std::string_view start) { return answers.port.starts_with(start); });
  if (LinkTable::is_serial(answers.port) == false)
    text +=
        "# No serial port in this plant.\n"
        "SupplementaryGroups=\n"
        "DeviceAllow=\n"
        "PrivateDevices=yes\n";
  else if (!is_known)
    text += "DeviceAllow=" + answers.port + " rw\n";
  return text;
}

// ---- Node-RED ---------------------------------------------------------------------------------

/// Creates a node on the flow's only tab.
JsonObject node(std::string_view id, std::string_view type, std::string_view name, int x, int y,
                std::string_view wires) {
  JsonObject out;
  out.text("id", id);
  out.text("type", type);
  out.text("z", "fxagent-tab");
  out.text("name", name);
  out.integer("x", x);
  out.integer("y", y);
  out.raw("wires", std::string(wires));
  return out;
}

JsonObject mqtt_in(std::string_view id, std::string_view name, const std::string& topic, int y,
                   std::string_view wires) {
  JsonObject out = node(id, "mqtt in", name, 160, y, wires);
  out.text("topic", topic);
  out.text("qos", "1");
  out.text("datatype", "json");
  out.text("broker", "fxagent-broker");
  out.raw("nl", "false");
  out.raw("rap", "true");
  out.raw("rh", "0");
  out.integer("inputs", 0);
  return out;
}

JsonObject debug(std::string_view id, std::string_view name, int y) {
  JsonObject out = node(id, "debug", name, 700, y, "[]");
  out.raw("active", "true");
  out.raw("tosidebar", "true");
  out.raw("console", "false");
  out.raw("tostatus", "true");
  out.text("complete", "payload");
  out.text("targetType", "msg");
  return out;
}

JsonObject broker_node(const Config& config) {
  const std::string& server = config.mqtt.servers.front();
  const std::size_t host = server.find("://") + 3;
  const std::size_t colon = server.rfind(':');
  JsonObject out;
  out.text("id", "fxagent-broker");
  out.text("type", "mqtt-broker");
  out.text("name", "the agent's broker");
  out.text("broker", server.substr(host, colon - host));
  out.text("port", server.substr(colon + 1));
  out.text("clientid", "");
  out.raw("autoConnect", "true");
  out.raw("usetls", server.starts_with("mqtts://") ? "true" : "false");
  out.text("protocolVersion", "5");
  out.text("keepalive", "60");
  out.raw("cleansession", "true");
  return out;
}

/// Adds a node that sends a set-point when clicked. Each command needs a new id.
void add_set_point(std::vector<JsonObject>& nodes, const Config& config, const TagConfig& tag) {
  const std::string name(std::string_view(tag.name));
  JsonObject inject =
      node("fxagent-value", "inject", "set " + name, 160, 300, R"([["fxagent-command"]])");
  const bool is_bit = tag.point.type == DataType::boolean;
  inject.raw("props", R"([{"p": "payload"}])");
  inject.raw("repeat", "\"\"");
  inject.raw("crontab", "\"\"");
  inject.raw("once", "false");
  inject.text("payload", is_bit ? "true" : "0");
  inject.text("payloadType", is_bit ? "bool" : "num");
  nodes.push_back(inject);
  JsonObject command =
      node("fxagent-command", "function", "command", 360, 300, R"([["fxagent-send"]])");
  command.text("func", "msg.payload = {id: RED.util.generateId(), op: \"write\", tag: \"" + name +
                           "\", value: msg.payload, by: \"node-red\"};\nreturn msg;");
  command.integer("outputs", 1);
  nodes.push_back(command);
  JsonObject send = node("fxagent-send", "mqtt out", "send", 540, 300, "[]");
  send.text("topic", config.base_topic() + "/" + config.devices.front().name + "/command");
  send.text("qos", "1");
  send.text("retain", "false");
  send.text("broker", "fxagent-broker");
  nodes.push_back(send);
}

std::string flow_text(const Config& config) {
  const std::string base = config.base_topic();
  JsonObject tab;
  tab.text("id", "fxagent-tab");
  tab.text("type", "tab");
  tab.text("label", "fxagent " + config.id);
  tab.text("info", "Made by fxagent init. Give the broker node its user and password.");
  std::vector<JsonObject> nodes{tab, broker_node(config)};
  nodes.push_back(
      mqtt_in("fxagent-data", "samples", base + "/+/data/+", 100, R"([["fxagent-show-data"]])"));
  nodes.push_back(debug("fxagent-show-data", "samples", 100));
  nodes.push_back(
      mqtt_in("fxagent-state", "states", base + "/+/state", 160, R"([["fxagent-show-state"]])"));
  nodes.push_back(debug("fxagent-show-state", "states", 160));
  nodes.push_back(mqtt_in("fxagent-result", "results", base + "/+/result", 220,
                          R"([["fxagent-show-result"]])"));
  nodes.push_back(debug("fxagent-show-result", "results", 220));
  const auto& tags = config.devices.front().tags;
  const auto written = std::ranges::find_if(tags, &TagConfig::writable);
  if (written != tags.end()) add_set_point(nodes, config, *written);
  return pretty_text(list_of(nodes));
}

/// Returns the flag that set a place of the config, or the place itself if no flag did.
std::string flag_of(const std::string& pointer, const InitAnswers& answers) {
  constexpr std::array<std::pair<std::string_view, std::string_view>, 10> kFlags{
      {{"/agent/id", "--id"},
       {"/mqtt/servers", "--broker"},
       {"/mqtt/username", "--user"},
       {"/mqtt/password_file", "--password-file"},
       {"/links", "--port"},
       {"/devices/0/name", "--device"},
       {"/devices/0/protocol", "--protocol"},
       {"/devices/0/model", "--model"},
       {"/devices/0/unit", "--unit"},
       {"/devices/0/station", "--unit"}}};
  for (const auto& [place, flag] : kFlags)
    if (pointer.starts_with(place)) return std::string(flag);
  constexpr std::string_view kTags = "/devices/0/tags/";
  if (!pointer.starts_with(kTags)) return pointer;
  const std::size_t tag = std::strtoul(pointer.c_str() + kTags.size(), nullptr, 10);
  if (tag < answers.read.size()) return "--read " + answers.read[tag];
  const std::size_t written = tag - answers.read.size();
  return written < answers.write.size() ? "--write " + answers.write[written] : pointer;
}

/// Collects faults, one a line.
class Faults {
 public:
  void add(const std::string& text) { text_ += (text_.empty() ? "" : "\n") + text; }
  bool any() const { return !text_.empty(); }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

}  // namespace

std::vector<std::string> init_file_names() {
  return {std::string(kConfig), std::string(kAcl), std::string(kDropIn), std::string(kFlow)};
}

std::string_view example_address(const ProtocolInfo& protocol) {
  const auto codec = protocol.make(default_options(protocol));
  const bool is_plc = codec && (*codec)->addresses().parse_address("D0", std::nullopt).has_value();
  return is_plc ? "D0" : "hr:0";
}

tl::expected<std::vector<InitFile>, std::string> init_files(const InitAnswers& given,
                                                            const std::string& directory) {
  InitAnswers answers = given;
  if (!answers.user.empty() && answers.password_file.empty()) answers.password_file = kPassword;
  if (answers.user.empty() && !answers.password_file.empty()) answers.user = answers.id;
  Faults faults;
  if (!LinkTable::is_serial(answers.port)) {
    faults.add("--port must be a serial port such as /dev/ttyUSB0, or host:port");
    answers.port = placeholder_port(answers.protocol);
  }
  if (answers.unit.find_first_not_of("0123456789") != answers.unit.npos) {
    faults.add("--unit must be a number");
    answers.unit.clear();
  }
  const std::string text = config_text(answers);
  const auto config = parse_config(text);
  if (!config)
    for (const ConfigError& error : config.error())
      faults.add(flag_of(error.pointer, answers) + ": " + error.text);
  if (faults.any()) return tl::unexpected(faults.text());
  const auto acl = acl_text(
      *config, {answers.user.empty() ? answers.id : answers.user, {answers.operator_name}, {}});
  if (!acl) return tl::unexpected(acl.error());
  return std::vector<InitFile>{{std::string(kConfig), text},
                               {std::string(kAcl), *acl},
                               {std::string(kDropIn), drop_in_text(answers, directory)},
                               {std::string(kFlow), flow_text(*config)}};
}

}  // namespace fxagent
