#include "agent/config/loader.h"

#include <algorithm>
#include <filesystem>
#include <vector>

#include "agent/config/config_error.h"
#include "agent/config/json/tree.h"
#include "agent/config/keys.h"
#include "agent/config/read/reader.h"
#include "agent/config/read/sections.h"
#include "agent/config/suggestions.h"
#include "agent/text/sha256.h"

namespace fxagent {
namespace {

// The text of a frame is at most this many times as long as its place in the ring.
constexpr std::uint64_t kTextOfRing = 4;
constexpr std::uint64_t kMostRings = std::uint64_t{64} << 20;

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
  config.id = reader.name(agent, "agent.id").value_or("");
  config.root =
      reader.text(agent, "agent.root").value_or(std::string(config_key("agent.root").word()));
  if (const auto fault = root_fault(config.root); !fault.empty())
    reader.error(*agent.find("root"), std::string(fault));
  config.remote = read_remote_limits(reader, agent);
}

void read_store(ConfigReader& reader, const ConfigNode& node, StoreConfig& store) {
  store.path = reader.text(node, "store.path").value_or("");
  reader.set_integer(store.max_bytes, node, "store.max_bytes");
  reader.set_integer(store.max_age, node, "store.max_age_h");
  store.sync_always = reader.choice_or_default(node, "store.sync") == 1;
  reader.set_integer(store.audit_max_bytes, node, "store.audit_max_bytes");
  reader.set_integer(store.audit_max_age, node, "store.audit_max_age_h");
}

std::optional<RecorderConfig> read_recorder(ConfigReader& reader, const ConfigNode& node) {
  const auto path = reader.text(node, "recorder.path");
  RecorderConfig recorder;
  if (const auto bytes = reader.integer(node, "recorder.link_bytes"))
    recorder.link_bytes = static_cast<std::uint64_t>(*bytes);
  reader.set_integer(recorder.files, node, "recorder.files");
  reader.set_integer(recorder.max_bytes, node, "recorder.max_bytes");
  if (!path) return std::nullopt;
  recorder.path = *path;
  return recorder;
}

/// Checks the recorder against the number of links.
void finish_recorder(ConfigReader& reader, const ConfigNode& node, const Config& config) {
  const std::uint64_t ring = ring_bytes(*config.recorder, config.links.size());
  if (config.recorder->max_bytes / kTextOfRing < ring)
    reader.error(node, "max_bytes must be at least " + std::to_string(kTextOfRing) +
                           " times link_bytes: one recording of a full link needs that much");
  if (ring * config.links.size() > kMostRings)
    reader.error(node, "link_bytes must be lower: all links together would use more than " +
                           std::to_string(kMostRings >> 20) + " MiB of memory");
}

// Levels that the filters of other topics end with.
constexpr std::array<std::string_view, 4> kTakenMembers{"state", "meta", "command", "result"};

std::optional<PairConfig> read_pair(ConfigReader& reader, const ConfigNode& node,
                                    const Config& config) {
  const auto member = reader.name(node, "pair.member");
  PairConfig pair;
  reader.set_integer(pair.quiet, node, "pair.quiet_ms");
  if (config.store.path.empty())
    reader.error(node,
                 "a pair needs a store: the standby keeps the ids of commands there, so that a "
                 "takeover repeats none");
  if (config.mqtt.version != 5)
    reader.error(node, "a pair needs MQTT 5: the broker keeps what the standby must not miss");
  if (config.remote.enabled)
    reader.error(
        node,
        "a pair has no remote config, because the gateway on standby would miss it: remove "
        "agent.remote_config, and change the files of both gateways");
  if (!member) return std::nullopt;
  if (contains(kTakenMembers, *member))
    reader.error(node, "member must not be " + *member + ", which is a level of other topics");
  pair.member = *member;
  return pair;
}

/// Warns of the devices whose answer may come after a takeover.
void warn_of_slow_devices(ConfigReader& reader, const ConfigNode& node, const Config& config) {
  constexpr std::size_t kNamed = 8;
  std::vector<std::string_view> slow;
  std::chrono::milliseconds longest{0};
  bool has_own_timer = false;
  for (const DeviceConfig& device : config.devices) {
    if (2 * device.timeout <= config.pair->quiet) continue;
    slow.emplace_back(device.name);
    longest = std::max(longest, std::chrono::milliseconds(device.timeout));
    has_own_timer =
        has_own_timer || (device.protocol != nullptr &&
                          option_named(*device.protocol, "monitoring_timer_ms") != nullptr);
  }
  if (slow.empty()) return;
  const std::size_t others = slow.size() - std::min(slow.size(), kNamed);
  slow.resize(slow.size() - others);
  reader.warn(node,
              "an answer of " + joined(slow, ", ") +
                  (others > 0 ? " and " + std::to_string(others) + " more" : "") +
                  " may come after the other gateway has begun: make timeout_ms " +
                  std::to_string((config.pair->quiet / 2).count()) + " or less" +
                  (has_own_timer ? " (and monitoring_timer_ms shorter than timeout_ms)" : "") +
                  ", or quiet_ms " + std::to_string((2 * longest).count()) + " or more");
}

Config read_top(ConfigReader& reader, const ConfigNode& top, FilePrivacy privacy) {
  Config config;
  if (!reader.check_object(top, "")) return config;
  reader.text(top, "$schema");
  if (const ConfigNode* agent = reader.object(top, "agent")) read_agent(reader, *agent, config);
  if (const ConfigNode* mqtt = reader.object(top, "mqtt"))
    read_mqtt(reader, *mqtt, config, privacy);
  if (const ConfigNode* brokers = reader.array(top, "brokers"))
    read_brokers(reader, *brokers, config, privacy);
  if (const ConfigNode* store = reader.object(top, "store"))
    read_store(reader, *store, config.store);
  else if (top.find("store") == nullptr)
    reader.warn(top,
                "no store: samples are lost while the broker is unreachable, and a restart loses "
                "the ids of commands");
  config.http = read_http(reader, top);
  const ConfigNode* recorder = reader.object(top, "recorder");
  if (recorder != nullptr) config.recorder = read_recorder(reader, *recorder);
  const ConfigNode* pair = reader.object(top, "pair");
  if (pair != nullptr) config.pair = read_pair(reader, *pair, config);
  Links links;
  const ConfigNode* link_array = reader.array(top, "links");
  if (link_array != nullptr)
    links = read_links(reader, *link_array, config);
  else
    links.names.add_unnamed();
  if (const ConfigNode* devices = reader.array(top, "devices")) {
    if (devices->children.empty()) reader.warn(*devices, "no devices: the agent reads nothing");
    read_devices(reader, top, *devices, links, config);
  }
  if (link_array != nullptr) finish_links(reader, *link_array, links, config);
  if (const ConfigNode* profiles = reader.array(top, "profiles"))
    read_profiles(reader, *profiles, config);
  const auto is_pair = [](const auto& named) { return named.name == "pair"; };
  if (config.pair &&
      (std::ranges::any_of(config.devices, is_pair) || std::ranges::any_of(config.links, is_pair)))
    reader.error(
        *pair, "a device or a link has the name \"pair\", and the pair uses its topics: rename it");
  if (config.pair) warn_of_slow_devices(reader, *pair, config);
  set_silences(config);
  if (config.recorder) finish_recorder(reader, *recorder, config);
  if (const auto memory = reader.room().size().memory(); memory > kMuchMemory)
    reader.warn(top,
                "the agent needs about " + std::to_string(memory >> 20) +
                    " MiB of memory for this config, and its service may use 256: raise MemoryMax "
                    "(systemctl edit fxagent), or divide the devices among several agents");
  return config;
}

}  // namespace

tl::expected<Config, ConfigErrors> parse_config(std::string_view text,
                                                const Environment& environment, FilePrivacy privacy,
                                                const ReadBounds& bounds) {
  const auto tree =
      ConfigTree::parse(text, ConfigTree::Folding::tags, {.stop = bounds.stop}, Comments::allowed);
  if (!tree) return tl::unexpected(ConfigErrors{tree.error()});
  ConfigReader reader(*tree, environment, bounds);
  Config config = read_top(reader, tree->root(), privacy);
  if (bounds.is_stopped())
    return tl::unexpected(ConfigErrors{ConfigError{"", 0, "could not be read completely"}});
  if (auto errors = reader.errors(); !errors.empty()) return tl::unexpected(std::move(errors));
  config.warnings = reader.warnings();
  config.hash = short_hash(text);
  return config;
}

tl::expected<Config, ConfigErrors> load_config(const std::string& path, std::string* text) {
  auto read = read_config_file(path);
  if (!read) return tl::unexpected(std::move(read.error()));
  auto config = config_of_file(path, *read, privacy_of(path));
  if (text != nullptr) *text = *std::move(read);
  return config;
}

tl::expected<Config, ConfigErrors> config_of_file(const std::string& path, std::string_view text,
                                                  FilePrivacy privacy, const ReadBounds& bounds) {
  auto config = parse_config(text, process_environment, privacy, bounds);
  if (!config) return config;

  const std::filesystem::path directory = std::filesystem::path(path).parent_path();
  const auto resolve = [&](std::string& name) {
    if (!name.empty()) name = (directory / name).string();
  };
  resolve(config->store.path);
  if (config->recorder) resolve(config->recorder->path);
  if (config->http) resolve(config->http->token_file);
  const auto resolve_files = [&](MqttConfig& mqtt) {
    resolve(mqtt.password_file);
    if (!mqtt.tls) return;
    resolve(mqtt.tls->ca_file);
    resolve(mqtt.tls->cert_file);
    resolve(mqtt.tls->key_file);
  };
  resolve_files(config->mqtt);
  for (BrokerConfig& broker : config->brokers) resolve_files(broker.mqtt);
  return config;
}

}  // namespace fxagent
