#include "agent/config/config.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <span>
#include <tuple>

#include "agent/config/file_privacy.h"
#include "agent/config/keys.h"
#include "agent/config/read/channel.h"
#include "agent/config/read/config_limits.h"
#include "agent/config/read/device.h"
#include "agent/config/read/metrics.h"
#include "agent/config/read/reader.h"
#include "agent/config/read/remote_limits.h"
#include "agent/config/read/tree.h"
#include "agent/config/warnings.h"
#include "agent/sha256.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

constexpr std::size_t kHashBytes = 8;
constexpr int kEightBits = 8;

// ---- agent, mqtt, store -----------------------------------------------------------------------

/// Returns why `root` cannot be a topic prefix; empty if it can.
std::string_view root_fault(std::string_view root) {
  if (root.find_first_of("+#") != root.npos) return "must not have the wildcards + and #";
  if (root.starts_with('/') || root.ends_with('/')) return "must not begin or end with /";
  if (root.find("//") != root.npos) return "must not have an empty level (//)";
  if (root.starts_with('$')) return "must not begin with $, which belongs to the broker";
  if (root.size() > 256) return "must not be longer than 256 bytes";
  return {};
}

void read_agent(ConfigReader& reader, const ConfigNode& agent, Config& config) {
  reader.check_object(agent, config_section("agent"));
  config.id = reader.name(agent, config_key("agent.id")).value_or("");
  config.root = reader.text(agent, config_key("agent.root"))
                    .value_or(std::string(config_key("agent.root").word()));
  if (const auto fault = root_fault(config.root); !fault.empty())
    reader.error(*agent.find("root"), std::string(fault));
  config.remote = read_remote_limits(reader, agent);
}

/// Returns "mqtt://host:port" with the port filled in, or the fault of the address.
tl::expected<std::string, std::string_view> normal_server(std::string_view server) {
  std::string out;
  std::string_view port;
  if (server.starts_with("mqtt://")) {
    out = "mqtt://";
    port = "1883";
  } else if (server.starts_with("mqtts://")) {
    out = "mqtts://";
    port = "8883";
  } else {
    return tl::unexpected("must begin with mqtt:// or mqtts://"sv);
  }
  server.remove_prefix(out.size());
  if (server.find('@') != server.npos)
    return tl::unexpected(
        "must not carry a user or a password; they go into username and password_file"sv);
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
      return tl::unexpected("must be scheme, host and port alone, as in mqtt://broker:1883"sv);
  }
  out += server.substr(0, host_end);
  server.remove_prefix(host_end);
  if (!server.empty()) {
    port = server.substr(1);
    const bool digits =
        !port.empty() && port.size() <= 5 && port.find_first_not_of("0123456789") == port.npos;
    const int value = digits ? std::atoi(std::string(port).c_str()) : 0;
    if (server[0] != ':' || value < 1 || value > 65535)
      return tl::unexpected("needs a port from 1 to 65535 after the host, or none"sv);
  }
  return out + ":" + std::string(port);
}

void read_tls(ConfigReader& reader, const ConfigNode& node, MqttConfig& mqtt) {
  reader.check_object(node, config_section("mqtt.tls"));
  TlsSettings tls;
  tls.ca_file = reader.text(node, config_key("mqtt.tls.ca_file")).value_or("");
  tls.cert_file = reader.text(node, config_key("mqtt.tls.cert_file")).value_or("");
  tls.key_file = reader.text(node, config_key("mqtt.tls.key_file")).value_or("");
  if ((node.find("cert_file") == nullptr) != (node.find("key_file") == nullptr))
    reader.error(node, "cert_file and key_file belong together");
  const bool encrypted = std::ranges::any_of(
      mqtt.servers, [](const std::string& server) { return server.starts_with("mqtts://"); });
  if (!encrypted) reader.warn(node, "has no effect, since no server is mqtts://");
  mqtt.tls = tls;
}

/// True if the server is on this machine.
bool is_loopback(std::string_view server) {
  server.remove_prefix(server.find("://") + 3);
  return server.starts_with("127.") || server.starts_with("localhost:") ||
         server.starts_with("[::1]:");
}

void read_password(ConfigReader& reader, const ConfigNode& node, MqttConfig& mqtt,
                   FilePrivacy privacy) {
  mqtt.password_file = reader.text(node, config_key("mqtt.password_file")).value_or("");
  mqtt.password_env = reader.text(node, config_key("mqtt.password_env")).value_or("");
  const bool is_allowed = reader.boolean(node, config_key("mqtt.allow_plain_secret"));
  if (const auto secret = reader.secret(node, config_key("mqtt.password"))) {
    const ConfigNode& at = *node.find("password");
    mqtt.password = secret->value;
    if (node.find("password_file") != nullptr || node.find("password_env") != nullptr)
      reader.error(at, "password_file or password_env already says where the password is");
    else if (secret->in_clear && privacy == FilePrivacy::shared && !is_allowed)
      reader.error(at,
                   "a password in clear in a file that others can read: put it into password_file "
                   "or password_env, or make this file private (chmod 600), or set "
                   "allow_plain_secret");
    else if (secret->in_clear && privacy == FilePrivacy::shared)
      reader.warn(at, "others can read this file, and with it the password");
  }
  constexpr std::array sources{"password_file"sv, "password_env"sv, "password"sv};
  for (const auto key : sources) {
    const ConfigNode* password = node.find(key);
    if (password == nullptr) continue;
    if (mqtt.version == 4 && node.find("username") == nullptr)
      reader.error(*password, "MQTT 3.1.1 knows no password without a username");
    for (const std::string& server : mqtt.servers)
      if (server.starts_with("mqtt://") && !is_loopback(server))
        reader.warn(*password, "it goes to " + server + " in clear; mqtts:// encrypts it");
  }
}

/// Returns the rule of the key table, "fx-{id}", with the id filled in.
std::string default_client_id(const std::string& id) {
  std::string text(std::get<ConfigKey::Rule>(config_key("mqtt.client_id").fallback).text);
  constexpr std::string_view place = "{id}";
  return text.replace(text.find(place), place.size(), id);
}

void read_mqtt(ConfigReader& reader, const ConfigNode& node, Config& config, FilePrivacy privacy) {
  reader.check_object(node, config_section("mqtt"));
  MqttConfig& mqtt = config.mqtt;
  if (const ConfigNode* servers = reader.array(node, config_key("mqtt.servers"))) {
    if (servers->children.empty()) reader.error(*servers, "needs at least one server");
    for (const ConfigNode& item : servers->children) {
      const auto text = reader.text(item);
      if (!text) continue;
      if (const auto server = normal_server(*text))
        mqtt.servers.push_back(*server);
      else
        reader.error(item, std::string(server.error()));
    }
  }
  mqtt.version = reader.choice_or_default(node, config_key("mqtt.version")) == 0 ? 5 : 4;
  mqtt.client_id =
      reader.text(node, config_key("mqtt.client_id")).value_or(default_client_id(config.id));
  mqtt.username = reader.text(node, config_key("mqtt.username")).value_or("");
  read_password(reader, node, mqtt, privacy);
  if (const ConfigNode* tls = reader.object(node, config_key("mqtt.tls")))
    read_tls(reader, *tls, mqtt);
  mqtt.keep_alive = reader.integer_as<std::chrono::seconds>(node, config_key("mqtt.keep_alive_s"));
  const ConfigNode* qos = node.find("qos");
  if (qos == nullptr || qos->number != 2)
    mqtt.qos = reader.integer_as<int>(node, config_key("mqtt.qos"));
  else
    reader.error(
        *qos,
        "must be 0 or 1; repeats under 1 can be told by their seq, so 2 would only cost time");
}

void read_store(ConfigReader& reader, const ConfigNode& node, StoreConfig& store) {
  reader.check_object(node, config_section("store"));
  store.path = reader.text(node, config_key("store.path")).value_or("");
  store.max_bytes = reader.integer_as<std::uint64_t>(node, config_key("store.max_bytes"));
  store.max_age = reader.integer_as<std::chrono::hours>(node, config_key("store.max_age_h"));
  store.sync_always = reader.choice_or_default(node, config_key("store.sync")) == 1;
  store.audit_max_bytes =
      reader.integer_as<std::uint64_t>(node, config_key("store.audit_max_bytes"));
  store.audit_max_age =
      reader.integer_as<std::chrono::hours>(node, config_key("store.audit_max_age_h"));
}

// ---- links ------------------------------------------------------------------------------------

/// Returns the line's settings: those of the file, or else the protocol's defaults.
SerialSettings line_settings(const LineKeys& keys, const LineDefaults& defaults) {
  SerialSettings line;
  line.baud = static_cast<int>(keys.baud.value_or(defaults.baud));
  line.data_bits = static_cast<int>(keys.data_bits.value_or(defaults.data_bits));
  line.parity = keys.parity.value_or(defaults.parity);
  line.stop_bits = static_cast<int>(keys.stop_bits.value_or(defaults.stop_bits));
  return line;
}

/// Returns the time of one character: start bit, data bits, parity bit, stop bits.
std::chrono::nanoseconds character_time(const SerialSettings& line) {
  const int bits = 1 + line.data_bits + (line.parity == Parity::none ? 0 : 1) + line.stop_bits;
  return std::chrono::nanoseconds((bits * std::int64_t{1'000'000'000} + line.baud / 2) / line.baud);
}

struct Links {
  NameTable names;
  std::vector<LineKeys> lines;
  std::vector<LinkFacts> facts;
};

void read_links(ConfigReader& reader, const ConfigNode& array, Links& links, Config& config) {
  Channels ports;
  Channels hosts;
  config.links.reserve(array.children.size());
  for (const ConfigNode& node : array.children) {
    if (!reader.has_room(node, {.links = 1})) return;
    LinkConfig& link = config.links.emplace_back();
    LineKeys& line = links.lines.emplace_back();
    LinkFacts& facts = links.facts.emplace_back();
    if (!reader.check_object(node, config_section("links[]"))) continue;
    if (const auto name = reader.name(node, config_key("links[].name"))) {
      link.name = *name;
      links.names.add(reader, *name, *node.find("name"),
                      static_cast<std::uint32_t>(config.links.size() - 1));
    }
    const ConfigNode* serial = reader.object(node, config_key("links[].serial"));
    const ConfigNode* tcp = reader.object(node, config_key("links[].tcp"));
    const ConfigNode* udp = reader.object(node, config_key("links[].udp"));
    const bool has_serial = node.find("serial") != nullptr;
    const bool has_tcp = node.find("tcp") != nullptr;
    if (has_serial + has_tcp + (node.find("udp") != nullptr) != 1) {
      reader.error(node, "needs either \"serial\", \"tcp\" or \"udp\"");
      continue;
    }
    using Channel = LinkFacts::Channel;
    facts.channel = has_serial ? Channel::serial : has_tcp ? Channel::tcp : Channel::udp;
    if (serial != nullptr) read_serial(reader, node, *serial, ports, link, line);
    if (tcp != nullptr) read_tcp(reader, node, *tcp, hosts, link, line);
    if (udp != nullptr) read_udp(reader, node, *udp, hosts, link);
    link.poll_share =
        reader.integer_as<double>(node, config_key("links[].poll_share_percent")) / 100.0;
  }
}

/// Returns the node of the link's `data_bits`; nullptr if the file does not set it.
const ConfigNode* data_bits_of(const ConfigNode& link) {
  const ConfigNode* serial = link.find("serial");
  return (serial != nullptr ? *serial : link).find("data_bits");
}

/// Reports an error if the file sets fewer data bits than the protocol or an option of one of the
/// devices needs. A protocol needs its default unless the catalogue has least_data_bits. More bits
/// than needed are allowed.
void check_data_bits(ConfigReader& reader, const ConfigNode& link, std::size_t index, int given,
                     const ProtocolInfo& protocol, const SharedList<DeviceConfig>& devices) {
  const ConfigNode* at = data_bits_of(link);
  if (at == nullptr) return;
  const int least =
      protocol.least_data_bits != 0 ? protocol.least_data_bits : protocol.line.data_bits;
  if (given < least)
    return reader.error(
        *at, std::string(protocol.name) + " needs " + std::to_string(least) + " data bits");
  const bool may_be_binary = std::ranges::any_of(
      protocol.options, [](const OptionSpec& spec) { return spec.binary_from.has_value(); });
  if (given >= kEightBits || !may_be_binary) return;
  for (const DeviceConfig& device : devices) {
    if (device.link != index || device.options == nullptr) continue;
    const OptionSpec* binary = binary_option(protocol, *device.options);
    if (binary == nullptr) continue;
    const auto value = std::get<std::int64_t>(device.options->find(binary->key)->second);
    const std::string option = "\"" + std::string(binary->key) + "\" ";
    std::string text = option + std::to_string(value);
    text.append(" of ").append(device.name);
    text.append(" is binary and needs 8 data bits: set 8 here and in the PLC, or ").append(option);
    return reader.error(*at, text.append("below ").append(std::to_string(*binary->binary_from)));
  }
}

/// Fills in the line settings that the file leaves to the protocol of the link.
void finish_links(ConfigReader& reader, const ConfigNode& array, const Links& links,
                  Config& config) {
  SerialSettings unknown;
  unknown.baud = 0;
  std::vector<SerialSettings> lines(config.links.size(), unknown);
  for (std::size_t i = 0; i < config.links.size(); ++i) {
    LinkConfig& link = config.links[i];
    const LinkFacts& facts = links.facts[i];
    if (facts.first_device == nullptr) reader.warn(array.children[i], "no device uses this link");
    const LineDefaults defaults = facts.protocol != nullptr ? facts.protocol->line : LineDefaults{};
    const SerialSettings line = line_settings(links.lines[i], defaults);
    if (facts.protocol != nullptr)
      check_data_bits(reader, array.children[i], i, line.data_bits, *facts.protocol,
                      config.devices);
    if (auto* serial = std::get_if<SerialSettings>(&link.channel)) {
      SerialSettings whole = line;
      whole.path = serial->path;
      whole.rs485 = serial->rs485;
      *serial = std::move(whole);
    }
    if (facts.channel != LinkFacts::Channel::serial && !links.lines[i].baud) continue;
    link.char_time = character_time(line);
    lines[i] = line;
  }
  warn_of_lines(reader, array, lines, config);
}

/// Sets the silences that guard against late replies: the time that each link listens before its
/// first request, and the gap before requests on UDP.
void set_silences(Config& config) {
  for (DeviceConfig& device : config.devices) {
    if (device.codec == nullptr || device.link >= config.links.size()) continue;
    LinkConfig& link = config.links[device.link];
    const Recovery recovery = device.codec->after_silence();
    // A late reply does no harm if it carries a number, or if it goes to an earlier connection or
    // port.
    const auto* udp = std::get_if<UdpSettings>(&link.channel);
    if (udp != nullptr && recovery != Recovery::none)
      device.gap = std::max(device.gap, kQuietBetweenDatagrams);
    const bool is_another_port = udp != nullptr && udp->local_port == 0;
    if (recovery == Recovery::none || is_another_port) continue;
    if (udp == nullptr && recovery == Recovery::reconnect) continue;
    auto& listening = link.listening;
    listening = std::max(listening, std::min(2 * device.timeout, kLongestListening));
  }
}

// ---- the whole config -------------------------------------------------------------------------

Config read_top(ConfigReader& reader, const ConfigNode& top, FilePrivacy privacy) {
  Config config;
  if (!reader.check_object(top, config_section(""))) return config;
  reader.text(top, config_key("$schema"));
  if (const ConfigNode* agent = reader.object(top, config_key("agent")))
    read_agent(reader, *agent, config);
  if (const ConfigNode* mqtt = reader.object(top, config_key("mqtt")))
    read_mqtt(reader, *mqtt, config, privacy);
  if (const ConfigNode* store = reader.object(top, config_key("store")))
    read_store(reader, *store, config.store);
  else if (top.find("store") == nullptr)
    reader.warn(top,
                "no store: samples are lost while the broker is away, and the ids of commands are "
                "forgotten at a restart");
  if (const ConfigNode* metrics = reader.object(top, config_key("metrics")))
    config.metrics = read_metrics(reader, *metrics);
  Links links;
  const ConfigNode* link_array = reader.array(top, config_key("links"));
  if (link_array != nullptr) read_links(reader, *link_array, links, config);
  if (const ConfigNode* devices = reader.array(top, config_key("devices"))) {
    if (devices->children.empty()) reader.warn(*devices, "no devices: nothing will be read");
    read_devices(reader, top, *devices, links.names, links.facts, config);
  }
  if (link_array != nullptr) finish_links(reader, *link_array, links, config);
  set_silences(config);
  if (const auto memory = reader.room().size().memory(); memory > kMuchMemory)
    reader.warn(top, "the agent needs about " + std::to_string(memory >> 20) +
                         " MiB of memory for this, and its service has 256: give it more "
                         "(systemctl edit fxagent: MemoryMax), or spread the devices over agents");
  return config;
}

/// True if the nearest existing directory on `path` is writable.
bool can_be_made(std::filesystem::path path) {
  std::error_code ignored;
  while (!std::filesystem::exists(path, ignored)) {
    const auto above = path.parent_path();
    if (above == path || above.empty()) return above.empty() && ::access(".", W_OK) == 0;
    path = above;
  }
  return std::filesystem::is_directory(path, ignored) && ::access(path.c_str(), W_OK | X_OK) == 0;
}

/// True if a directory above `path` lacks this permission (S_IXGRP or S_IXOTH), so that it keeps
/// users with only that permission away from the file.
bool lies_behind_closed_doors(const std::filesystem::path& path, mode_t right) {
  std::error_code fault;
  auto above = std::filesystem::canonical(path, fault).parent_path();
  struct stat directory {};
  for (; above.has_relative_path(); above = above.parent_path())
    if (::stat(above.c_str(), &directory) == 0 && (directory.st_mode & right) == 0) return true;
  return false;
}

/// Secrets of containers. They are readable by all, but the container has no other users.
constexpr std::string_view kContainerSecrets = "/run/secrets/";

/// Returns the users who can read the file without need: "everybody" or "its group"; empty if none.
std::string_view readers_beside_owner(const std::string& path) {
  const auto credentials = process_environment("CREDENTIALS_DIRECTORY");
  struct stat file {};
  if ((credentials && path.starts_with(*credentials + "/")) ||
      path.starts_with(kContainerSecrets) || ::stat(path.c_str(), &file) != 0)
    return {};
  if ((file.st_mode & S_IROTH) != 0 && !lies_behind_closed_doors(path, S_IXOTH)) return "everybody";
  // A process that does not own the file may need the group's permission.
  const bool by_group = (file.st_mode & S_IRGRP) != 0 && file.st_uid == ::geteuid();
  return by_group && !lies_behind_closed_doors(path, S_IXGRP) ? "its group" : "";
}

}  // namespace

std::optional<std::string> process_environment(std::string_view name) {
  // No code changes the environment while the agent runs.
  const char* value = std::getenv(std::string(name).c_str());  // NOLINT(concurrency-mt-unsafe)
  return value == nullptr ? std::nullopt : std::optional<std::string>(value);
}

const std::shared_ptr<const TagUnits>& no_units() {
  static const auto none = std::make_shared<const TagUnits>();
  return none;
}

bool operator==(const TagConfig& a, const TagConfig& b) {
  return a.name == b.name && a.point == b.point && a.group == b.group && a.writable == b.writable &&
         (a.units == b.units || *a.units == *b.units);
}

bool operator==(const DeviceConfig& a, const DeviceConfig& b) {
  const auto settings = [](const DeviceConfig& device) {
    return std::tie(device.name, device.link, device.protocol, device.timeout, device.retries,
                    device.gap, device.turnaround, device.echo, device.max_block_bytes,
                    device.enquire, device.groups, device.commands, device.tags);
  };
  const bool same_codec =
      a.options == b.options || (a.options && b.options && *a.options == *b.options);
  return settings(a) == settings(b) && same_codec;
}

std::string to_string(const ConfigError& error, std::string_view file) {
  std::string text(file);
  if (error.line > 0) text += ":" + std::to_string(error.line);
  text += ": ";
  if (!error.pointer.empty()) text += error.pointer + ": ";
  return text + error.text;
}

tl::expected<Config, std::vector<ConfigError>> parse_config(std::string_view text,
                                                            const Environment& environment,
                                                            FilePrivacy privacy,
                                                            const ReadBounds& bounds) {
  const auto tree = ConfigTree::parse(text, ConfigTree::Folding::tags, {.stop = bounds.stop});
  if (!tree)
    return tl::unexpected(std::vector{ConfigError{"", tree.error().line, tree.error().text}});
  ConfigReader reader(*tree, environment, bounds);
  Config config = read_top(reader, tree->root(), privacy);
  if (bounds.is_stopped())
    return tl::unexpected(std::vector{ConfigError{"", 0, "was not read to its end"}});
  if (reader.failed()) return tl::unexpected(reader.errors());
  config.warnings = reader.warnings();
  config.hash = to_text(ByteView(sha256(text)).first(kHashBytes));
  return config;
}

tl::expected<Config, std::vector<ConfigError>> parse_config(std::string_view text,
                                                            const Environment& environment,
                                                            FilePrivacy privacy) {
  return parse_config(text, environment, privacy, {});
}

tl::expected<Config, std::vector<ConfigError>> parse_config(std::string_view text) {
  return parse_config(text, process_environment);
}

tl::expected<Config, std::vector<ConfigError>> load_config(const std::string& path) {
  auto text = read_config_file(path);
  if (!text) return tl::unexpected(std::move(text.error()));
  return config_of_file(path, *text);
}

FilePrivacy privacy_of(const std::string& path) {
  struct stat file {};
  const bool is_own = ::stat(path.c_str(), &file) == 0 && S_ISREG(file.st_mode) &&
                      (file.st_mode & (S_IRWXG | S_IRWXO)) == 0;
  return is_own ? FilePrivacy::owner_only : FilePrivacy::shared;
}

tl::expected<Config, std::vector<ConfigError>> config_of_file(const std::string& path,
                                                              std::string_view text) {
  return config_of_file(path, text, privacy_of(path));
}

tl::expected<Config, std::vector<ConfigError>> config_of_file(const std::string& path,
                                                              std::string_view text,
                                                              FilePrivacy privacy,
                                                              const ReadBounds& bounds) {
  auto config = parse_config(text, process_environment, privacy, bounds);
  if (!config) return config;

  const std::filesystem::path directory = std::filesystem::path(path).parent_path();
  const auto resolve = [&](std::string& name) {
    if (!name.empty()) name = (directory / name).string();
  };
  resolve(config->store.path);
  resolve(config->mqtt.password_file);
  if (config->mqtt.tls) {
    resolve(config->mqtt.tls->ca_file);
    resolve(config->mqtt.tls->cert_file);
    resolve(config->mqtt.tls->key_file);
  }
  return config;
}

std::vector<ConfigError> check_files(const Config& config) {
  std::vector<ConfigError> missing;
  const auto must_be_readable = [&](std::string pointer, const std::string& path) {
    if (!path.empty() && ::access(path.c_str(), R_OK) != 0)
      missing.push_back(
          {std::move(pointer), 0,
           shown(path) + " cannot be read: " + std::generic_category().message(errno)});
  };
  if (config.mqtt.tls) {
    must_be_readable("/mqtt/tls/ca_file", config.mqtt.tls->ca_file);
    must_be_readable("/mqtt/tls/cert_file", config.mqtt.tls->cert_file);
    must_be_readable("/mqtt/tls/key_file", config.mqtt.tls->key_file);
  }
  const auto& mqtt = config.mqtt;
  if (!mqtt.password_file.empty())  // goes before password_env
    must_be_readable("/mqtt/password_file", mqtt.password_file);
  else if (!mqtt.password_env.empty() && !process_environment(mqtt.password_env))
    missing.push_back({"/mqtt/password_env", 0,
                       "the environment variable " + shown(mqtt.password_env) + " is not set"});
  if (!config.store.path.empty() && !can_be_made(config.store.path))
    missing.push_back({"/store/path", 0, shown(config.store.path) + " cannot be written"});
  return missing;
}

std::vector<ConfigError> exposed_secrets(const Config& config) {
  std::vector<ConfigError> exposed;
  const auto look = [&](std::string pointer, const std::string& path) {
    const std::string_view who = path.empty() ? std::string_view() : readers_beside_owner(path);
    if (!who.empty())
      exposed.push_back({std::move(pointer), 0,
                         shown(path) + " can be read by " + std::string(who) + "; chmod 600 it"});
  };
  if (config.mqtt.tls) look("/mqtt/tls/key_file", config.mqtt.tls->key_file);
  look("/mqtt/password_file", config.mqtt.password_file);
  return exposed;
}

}  // namespace fxagent
