#include "agent/cli/setup/init_files.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <utility>

#include "agent/cli/doctor/guesses.h"
#include "agent/cli/setup/acl.h"
#include "agent/cli/setup/init_flow.h"
#include "agent/config/json/pretty.h"
#include "agent/config/loader.h"
#include "agent/import/imported.h"
#include "agent/text/json.h"

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

// ---- config -----------------------------------------------------------------------------------

/// Parses "temp=D100", or "D100", which gets a name derived from it.
JsonObject tag_of(const std::string& spelled, bool is_written, NameMaker& names) {
  std::vector<ImportNote> ignored;
  const std::size_t mark = spelled.find('=');
  const std::string address = mark == spelled.npos ? spelled : spelled.substr(mark + 1);
  const std::string name =
      mark == spelled.npos ? names.make(address, "tag", 0, ignored) : spelled.substr(0, mark);
  JsonObject tag = JsonObject::object({{"name", name}, {"address", address}, {"group", "fast"}});
  if (is_written) tag["access"] = "read_write";
  return tag;
}

JsonObject device_of(const InitAnswers& answers) {
  JsonObject device = JsonObject::object(
      {{"name", answers.device}, {"link", "line1"}, {"protocol", answers.protocol}});
  if (!answers.model.empty()) device["model"] = answers.model;
  const ProtocolInfo* protocol = find_protocol(answers.protocol);
  const auto key = protocol == nullptr ? ""sv : station_key(*protocol);
  if (!key.empty() && !answers.unit.empty())
    device[key] = json_number(std::strtod(answers.unit.c_str(), nullptr));
  device["groups"].push_back(JsonObject::object({{"name", "fast"}, {"interval_ms", 1000}}));
  NameMaker names;
  JsonObject& tags = device["tags"] = JsonObject::array();
  for (const std::string& spelled : answers.read) tags.push_back(tag_of(spelled, false, names));
  for (const std::string& spelled : answers.write) tags.push_back(tag_of(spelled, true, names));
  return device;
}

std::string config_text(const InitAnswers& answers) {
  Imported links;
  LinkTable(links).to(answers.port, answers.protocol);
  JsonObject out;
  out["agent"]["id"] = answers.id;
  out["mqtt"]["servers"].push_back(answers.broker);
  if (!answers.user.empty()) out["mqtt"]["username"] = answers.user;
  if (!answers.password_file.empty()) out["mqtt"]["password_file"] = answers.password_file;
  out["store"]["path"] = "/var/lib/fxagent";
  out["links"] = links.links;
  out["devices"].push_back(device_of(answers));
  return pretty_text(dumped(out));
}

// ---- unit drop-in -----------------------------------------------------------------------------

/// True for a path relative to the config, without environment variables.
bool is_beside_config(const std::string& file) {
  return !file.empty() && !file.starts_with('/') && file.find("${") == file.npos;
}

std::string drop_in_text(const InitAnswers& answers, const std::string& directory) {
  const std::string config = "/" + std::string(kConfig);
  const std::string place = std::string(kPlace) + config;
  std::string text = "# Additions to fxagent.service for this plant. Install it with:\n";
  if (directory != kPlace) {
    text += "#   install -D -m 644 " + directory + config + " " + place + "\n";
    if (const std::string& file = answers.password_file; is_beside_config(file))
      text += "#   install -D -m 600 -o fxagent " + directory + "/" + file + " " +
              std::string(kPlace) + "/" + file + "\n";
  }
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

/// Fills in the flow of config/node-red/init.json. Leaves out its set-point if no tag may be
/// written.
std::string flow_text(const Config& config) {
  const std::string& server = config.mqtt.servers.front();
  const std::size_t host = server.find("://") + 3;
  const std::size_t colon = server.rfind(':');
  const DeviceConfig& device = config.devices.front();
  const auto tag = std::ranges::find_if(device.tags, &TagConfig::writable);
  const bool has_tag = tag != device.tags.end();
  const bool is_bit = has_tag && tag->point.type == DataType::boolean;
  // No name and no host has a character that JSON escapes.
  const std::array<std::pair<std::string_view, std::string>, 9> values{
      {{"{id}", config.id},
       {"{base}", config.base_topic()},
       {"{host}", server.substr(host, colon - host)},
       {"{port}", server.substr(colon + 1)},
       {"\"{usetls}\"", server.starts_with("mqtts://") ? "true" : "false"},
       {"{device}", device.name},
       {"{tag}", has_tag ? std::string(tag->name) : std::string()},
       {"{payload}", is_bit ? "true" : "0"},
       {"{payload_type}", is_bit ? "bool" : "num"}}};
  std::string text(kInitFlow);
  for (const auto& [name, value] : values)
    for (auto at = text.find(name); at != text.npos; at = text.find(name, at + value.size()))
      text.replace(at, name.size(), value);
  if (has_tag) return text;
  auto nodes = JsonObject::parse(text);
  std::erase_if(nodes.get_ref<JsonObject::array_t&>(), [](const JsonObject& node) {
    constexpr std::array kSetPoint{"fxagent-value"sv, "fxagent-command"sv, "fxagent-send"sv};
    return std::ranges::find(kSetPoint, node["id"].get<std::string>()) != kSetPoint.end();
  });
  return pretty_text(dumped(nodes));
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
  std::string faults;  // one a line
  const auto add = [&faults](const std::string& text) {
    faults += (faults.empty() ? "" : "\n") + text;
  };
  if (!LinkTable::is_serial(answers.port)) {
    add("--port must be a serial port such as /dev/ttyUSB0, or host:port");
    answers.port = placeholder_port(answers.protocol);
  }
  if (answers.unit.find_first_not_of("0123456789") != answers.unit.npos) {
    add("--unit must be a number");
    answers.unit.clear();
  }
  const std::string text = config_text(answers);
  const auto config = parse_config(text);
  if (!config)
    for (const ConfigError& error : config.error())
      add(flag_of(error.pointer, answers) + ": " + error.text);
  if (!faults.empty()) return tl::unexpected(faults);
  const auto acl = acl_text(
      *config, {answers.user.empty() ? answers.id : answers.user, {answers.operator_name}, {}});
  if (!acl) return tl::unexpected(acl.error());
  return std::vector<InitFile>{{std::string(kConfig), text},
                               {std::string(kAcl), *acl},
                               {std::string(kDropIn), drop_in_text(answers, directory)},
                               {std::string(kFlow), flow_text(*config)}};
}

}  // namespace fxagent
