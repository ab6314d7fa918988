// Compares config/agent.schema.json and the tables of config/README.md with the table of keys.
#include "agent/config/keys.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;
using Type = ConfigKey::Type;

template <class... F>
struct Overload : F... {
  using F::operator()...;
};

/// The sections in the order of the README.
std::vector<std::string> sections() {
  std::vector<std::string> list;
  for (const ConfigKey& key : config_keys::kAll)
    if (list.empty() || list.back() != key.section) list.emplace_back(key.section);
  return list;
}

/// The keys of a section for devices of the protocol.
std::vector<ConfigKey> keys_of(std::string_view section, const ProtocolInfo& protocol) {
  const auto common = config_section(section);
  std::vector<ConfigKey> keys(common.begin(), common.end());
  const auto put = [&](const ConfigKey& own) {
    const auto same = std::ranges::find(keys, own.name, &ConfigKey::name);
    if (same != keys.end())
      *same = own;
    else
      keys.push_back(own);
  };
  if (section == "devices[]")
    for (const ConfigKey& own : protocol_keys(protocol)) put(own);
  if (section == "devices[].tags[]") put(word_order_key(&protocol));
  return keys;
}

std::string meaning_of(const ConfigKey& key) {
  constexpr std::string_view first = "0.1";
  return std::string(key.meaning) +
         (key.since == first ? "" : " Since " + std::string(key.since) + ".");
}

TEST(ConfigKeys, SectionsAreWholeAndKeysStandOnce) {
  const auto list = sections();
  EXPECT_EQ(std::set<std::string>(list.begin(), list.end()).size(), list.size());
  std::set<std::string> paths;
  for (const ConfigKey& key : config_keys::kAll)
    EXPECT_TRUE(paths.insert(std::string(key.section) + "." + std::string(key.name)).second)
        << key.section << " " << key.name;
}

TEST(ConfigKeys, MeaningsAreSentencesAndDefaultsAreAllowed) {
  const auto check = [](const ConfigKey& key) {
    EXPECT_TRUE(key.meaning.ends_with('.')) << key.name;
    if (key.type == Type::integer && std::holds_alternative<std::int64_t>(key.fallback)) {
      EXPECT_LE(key.limits.min, key.number()) << key.name;
      EXPECT_GE(key.limits.max, key.number()) << key.name;
    }
    if (key.type == Type::choice && std::holds_alternative<std::string_view>(key.fallback)) {
      EXPECT_LT(key.index(), key.limits.words.size()) << key.name;
    }
  };
  for (const ConfigKey& key : config_keys::kAll) check(key);
  for (const ProtocolInfo& protocol : catalog())
    for (const ConfigKey& key : protocol_keys(protocol)) check(key);
}

// ---- the schema -------------------------------------------------------------------------------

const json& schema() {
  static const json text = [] {
    std::ifstream file(FXAGENT_CONFIG_DIR "/agent.schema.json");
    return json::parse(file);
  }();
  return text;
}

/// Resolves every $ref, alone or in an allOf. Members next to an allOf take precedence.
json resolved(const json& node) {
  if (node.contains("$ref"))
    return resolved(schema().at(json::json_pointer(node["$ref"].get<std::string>().substr(1))));
  json out = node;
  if (node.contains("allOf"))
    for (const json& part : node["allOf"])
      if (part.contains("$ref")) {
        json base = resolved(part);
        base.update(out);
        out = base;
      }
  return out;
}

/// The schema of the object that has the keys of a section.
json schema_at(std::string_view section, const ProtocolInfo& protocol) {
  json node = schema();
  std::istringstream steps{std::string(section)};
  std::string step;
  while (std::getline(steps, step, '.')) {
    const bool items = step.ends_with("[]");
    if (items) step.resize(step.size() - 2);
    node = resolved(node.at("properties").at(step));
    if (items) node = resolved(node.at("items"));
    if (step != "devices") continue;
    node = resolved(node.at("else"));  // an entry for one device, without template
    for (const json& branch : json(node.at("allOf")))
      if (branch.at("if").at("properties").at("protocol").at("const") == protocol.name)
        node = resolved(branch.at("then"));
  }
  return node;
}

/// The keywords a schema must use for a key, and the expected values.
constexpr std::array kChecked{"type", "minimum", "maximum", "enum", "default"};

json expected_in_schema(const ConfigKey& key) {
  json out;
  switch (key.type) {
    case Type::name:
    case Type::text:
    case Type::path:
      out["type"] = "string";
      break;
    case Type::choice:
      out["type"] = "string";
      out["enum"] = key.limits.words;
      break;
    case Type::integer:
      out["type"] = "integer";
      out["minimum"] = key.limits.min;
      out["maximum"] = key.limits.max;
      break;
    case Type::number:
      out["type"] = "number";
      break;
    case Type::boolean:
      out["type"] = "boolean";
      break;
    case Type::object:
      out["type"] = "object";
      break;
    case Type::array:
      out["type"] = "array";
      break;
    case Type::numbers:
      break;  // a string or an array
  }
  std::visit(Overload{[](ConfigKey::None) {}, [](ConfigKey::Required) {}, [](ConfigKey::Rule) {},
                      [&](const auto& value) { out["default"] = value; }},
             key.fallback);
  return out;
}

void expect_same(const ConfigKey& key, const json& node) {
  const std::string place = std::string(key.section) + "." + std::string(key.name);
  EXPECT_TRUE(node.contains("title")) << place;
  if (key.is("devices[].protocol")) return;  // a const, already used to find the branch
  std::string meaning = meaning_of(key);
  if (const auto* rule = std::get_if<ConfigKey::Rule>(&key.fallback))
    meaning += " Default: " + std::string(rule->text) + ".";
  const std::string description = node.value("description", "");
  EXPECT_TRUE(description.starts_with(meaning))
      << place << " is described as \"" << description << "\", and means \"" << meaning << "\"";
  json said;
  for (const char* word : kChecked)
    if (node.contains(word)) said[word] = node[word];
  // Rules beyond ranges are code: format is 1 or 4, a deadband is not negative.
  if (key.type == Type::integer) said.erase("enum");
  if (key.type == Type::number) said.erase("minimum");
  EXPECT_EQ(said, expected_in_schema(key)) << place;
}

/// True for a key that selects the schema of many devices, in which all strings may contain `{n}`.
bool is_of_many(const ConfigKey& key) {
  return key.is("devices[].template") || key.is("devices[].n");
}

TEST(ConfigKeys, SchemaOfManyDevicesHasTheKeysOfAllProtocols) {
  const json& definitions = schema().at("definitions");
  const auto names_in = [&](const char* definition) {
    std::set<std::string> names;
    for (const auto& [name, value] : definitions.at(definition).at("properties").items())
      names.insert(name);
    EXPECT_EQ(definitions.at(definition).at("additionalProperties"), false);
    return names;
  };
  const auto names_of = [](const char* section) {
    std::set<std::string> names;
    for (const ProtocolInfo& protocol : catalog())
      for (const ConfigKey& key : keys_of(section, protocol)) names.emplace(key.name);
    return names;
  };
  EXPECT_EQ(names_in("many_devices"), names_of("devices[]"));
  EXPECT_EQ(names_in("many_groups"), names_of("devices[].groups[]"));
  EXPECT_EQ(names_in("many_tags"), names_of("devices[].tags[]"));
  EXPECT_EQ(names_in("many_commands"), names_of("devices[].commands"));
  for (const ConfigKey& key : config_section("devices[]"))
    if (is_of_many(key))
      expect_same(key, definitions.at("many_devices").at("properties").at(std::string(key.name)));
}

TEST(ConfigKeys, SchemaSaysTheSame) {
  for (const ProtocolInfo& protocol : catalog())
    for (const std::string& section : sections()) {
      const json object = schema_at(section, protocol);
      const json properties = object.at("properties");
      EXPECT_EQ(object.at("additionalProperties"), false) << section;
      std::set<std::string> known;
      std::set<std::string> required;
      for (const ConfigKey& key : keys_of(section, protocol)) {
        if (is_of_many(key)) continue;
        const std::string name(key.name);
        known.insert(name);
        if (key.is_required()) required.insert(name);
        if (properties.contains(name))
          expect_same(key, resolved(properties[name]));
        else
          ADD_FAILURE() << "the schema lacks " << section << "." << name;
      }
      for (const auto& [name, value] : properties.items())
        EXPECT_TRUE(known.contains(name)) << section << "." << name << " is in the schema only";
      // The protocol branches of a device have no list of their own.
      const json list = section == "devices[]"
                            ? schema().at("definitions").at("device").at("required")
                            : object.value("required", json::array());
      EXPECT_EQ(list.get<std::set<std::string>>(), required) << section;
    }
}

TEST(ConfigKeys, SchemaNamesTheProtocols) {
  EXPECT_EQ(schema().at("definitions").at("device").at("properties").at("protocol").at("enum"),
            json(protocol_key().limits.words));
}

// ---- the README -------------------------------------------------------------------------------

std::string quoted(std::span<const std::string_view> words) {
  std::string out;
  for (const auto word : words) out += (out.empty() ? "`" : " `") + std::string(word) + "`";
  return out;
}

std::string range_of(const ConfigKey& key) {
  const auto& [min, max, words] = key.limits;
  switch (key.type) {
    case Type::name:
      return "name";
    case Type::text:
      return "string";
    case Type::path:
      return "path";
    case Type::choice:
      return quoted(words);
    case Type::integer:
      return std::to_string(min) + (max - min == 1 ? ", " : "–") + std::to_string(max);
    case Type::number:
      return "number";
    case Type::boolean:
      return "boolean";
    case Type::object:
      return "object";
    case Type::array:
      return "array";
    case Type::numbers:
      return "range or list";
  }
  return {};
}

std::string default_of(const ConfigKey& key) {
  return std::visit(Overload{[](ConfigKey::None) { return std::string("none"); },
                             [](ConfigKey::Required) { return std::string("required"); },
                             [](ConfigKey::Rule rule) { return std::string(rule.text); },
                             [](bool flag) { return std::string(flag ? "true" : "false"); },
                             [](std::int64_t number) { return std::to_string(number); },
                             [](std::string_view word) { return "`" + std::string(word) + "`"; }},
                    key.fallback);
}

std::string row(const std::string& prefix, const ConfigKey& key) {
  return "| `" + prefix + std::string(key.name) + "` | " + range_of(key) + " | " + default_of(key) +
         " | " + meaning_of(key) + " |\n";
}

constexpr std::string_view kHead = "| key | type, range | default | meaning |\n|---|---|---|---|\n";

/// One table per section. Sections of objects without their own table are part of the parent's
/// table. The tables of the protocols follow the table of devices.
std::string tables() {
  const std::set<std::string_view> within{"mqtt.tls", "links[].serial", "links[].tcp",
                                          "links[].udp"};
  std::string out;
  for (const std::string& section : sections()) {
    if (within.contains(section)) continue;
    out += kHead;
    for (const ConfigKey& key : config_section(section)) {
      out += row("", key.is("devices[].protocol") ? protocol_key() : key);
      const std::string below = section + "." + std::string(key.name);
      if (within.contains(below))
        for (const ConfigKey& inner : config_section(below))
          out += row(std::string(key.name) + ".", inner);
    }
    if (section != "devices[]") continue;
    std::string before;
    for (const ProtocolInfo& protocol : catalog()) {
      std::string table(kHead);
      for (const ConfigKey& key : protocol_keys(protocol)) table += row("", key);
      if (table != before) out += table;  // the Modbus protocols share one table
      before = table;
    }
  }
  return out;
}

TEST(ConfigKeys, ReadmeHasTheirTables) {
  std::ifstream file(FXAGENT_CONFIG_DIR "/README.md");
  std::string found;
  std::string line;
  bool inside = false;
  while (std::getline(file, line)) {
    inside = line.starts_with("| key |") || (inside && line.starts_with("|"));
    if (inside) found += line + "\n";
  }
  EXPECT_EQ(found, tables());
}

TEST(ConfigKeys, ReadmeHasTheSmallestFileOfEachProtocol) {
  std::ifstream file(FXAGENT_CONFIG_DIR "/README.md");
  std::string line;
  while (std::getline(file, line) && line != "## The smallest file for each protocol") continue;
  std::vector<std::string_view> protocols;
  std::string text;
  bool inside = false;
  while (std::getline(file, line) && !line.starts_with("## ")) {
    if (inside && line == "```") {
      const Config config = good(text);
      EXPECT_TRUE(config.warnings.empty()) << config.warnings.front();
      ASSERT_EQ(config.devices.size(), 1U) << text;
      EXPECT_FALSE(config.devices[0].tags.empty());
      protocols.push_back(config.devices[0].protocol->name);
    }
    if (inside) text += line + "\n";
    if (line.starts_with("```")) inside = line == "```json";
    if (line == "```json") text.clear();
  }
  EXPECT_TRUE(std::ranges::equal(protocols, protocol_key().limits.words));
}

// ---- the loader -------------------------------------------------------------------------------

/// An absent key must have the same effect as the key with its default.
TEST(ConfigKeys, AbsentKeysHaveTheirDefaults) {
  json plant = small_plant();
  plant["devices"][0].erase("commands");
  plant["devices"][0]["groups"] = json::parse(R"([{"name": "fast"}])");
  plant["devices"][0]["commands"] = json::object();
  const Config config = good(plant.dump());
  const auto number = [](const ConfigKey& key) { return key.number(); };
  EXPECT_EQ(config.mqtt.client_id, "fx-edge7");
  EXPECT_EQ(config.mqtt.version, 5);
  EXPECT_EQ(config.mqtt.keep_alive.count(), number(config_key("mqtt.keep_alive_s")));
  EXPECT_EQ(config.mqtt.qos, number(config_key("mqtt.qos")));
  EXPECT_EQ(config.store.max_bytes,
            static_cast<std::uint64_t>(number(config_key("store.max_bytes"))));
  EXPECT_EQ(config.store.max_age.count(), number(config_key("store.max_age_h")));
  EXPECT_FALSE(config.store.sync_always);
  EXPECT_EQ(config.store.audit_max_bytes,
            static_cast<std::uint64_t>(number(config_key("store.audit_max_bytes"))));
  EXPECT_EQ(config.store.audit_max_age.count(), number(config_key("store.audit_max_age_h")));
  const Config two_wire = good(changed("/links/0/serial/rs485", "{}"));
  const Rs485 direction = std::get<SerialSettings>(two_wire.links[0].channel).rs485.value();
  EXPECT_EQ(direction.rts_on_send, config_key("links[].serial.rs485.rts_on_send").flag());
  EXPECT_EQ(direction.delay_before.count(),
            number(config_key("links[].serial.rs485.delay_before_ms")));
  EXPECT_EQ(direction.delay_after.count(),
            number(config_key("links[].serial.rs485.delay_after_ms")));
  EXPECT_DOUBLE_EQ(config.links[0].poll_share * 100,
                   static_cast<double>(number(config_key("links[].poll_share_percent"))));
  const DeviceConfig& device = config.devices[0];
  EXPECT_EQ(device.timeout.count(), number(config_key("devices[].timeout_ms")));
  EXPECT_EQ(device.retries, number(config_key("devices[].retries")));
  EXPECT_EQ(device.gap.count(), number(config_key("devices[].gap_ms")));
  EXPECT_EQ(device.turnaround.count(), number(config_key("devices[].turnaround_ms")));
  EXPECT_EQ(device.echo, config_key("devices[].echo").flag());
  EXPECT_EQ(device.enquire, EnquirePolicy::open);
  EXPECT_EQ(device.groups[0].interval.count(),
            number(config_key("devices[].groups[].interval_ms")));
  EXPECT_FALSE(device.groups[0].on_change);
  EXPECT_EQ(device.groups[0].max_silent.count(),
            number(config_key("devices[].groups[].max_silent_s")));
  EXPECT_FALSE(device.tags[0].writable);
  EXPECT_EQ(device.tags[0].point.order, ByteOrder::cdab);
  EXPECT_EQ(device.groups.at(device.tags[1].group).name,
            config_key("devices[].tags[].group").word());
  const CommandRules& rules = device.commands;
  EXPECT_TRUE(rules.allow.empty());
  EXPECT_EQ(rules.allow_run_stop, config_key("devices[].commands.allow_run_stop").flag());
  EXPECT_EQ(rules.default_expiry.count(),
            number(config_key("devices[].commands.default_expiry_s")));
  EXPECT_EQ(rules.max_expiry.count(), number(config_key("devices[].commands.max_expiry_s")));
  EXPECT_EQ(rules.verify, config_key("devices[].commands.verify").flag());
  EXPECT_EQ(rules.queue, static_cast<std::size_t>(number(config_key("devices[].commands.queue"))));

  // The same if the section is absent, so that it needs no separate code.
  plant.erase("store");
  plant["agent"].erase("root");
  const Config bare = good(plant.dump());
  EXPECT_EQ(bare.root, config_key("agent.root").word());
  EXPECT_EQ(bare.store.max_age, config.store.max_age);
}

/// Options use the codec's own defaults, so that no default is written twice.
TEST(ConfigKeys, OptionsGivenWithTheirDefaultsChangeNothing) {
  for (const ProtocolInfo& protocol : catalog()) {
    json plant = small_plant();
    json& device = plant["devices"][1];
    device = {{"name", "mixer"}, {"link", "gw1"}, {"protocol", protocol.name}};
    const Options absent = *good(plant.dump()).devices[1].options;
    for (const ConfigKey& key : protocol_keys(protocol))
      device.update(expected_in_schema(key).contains("default")
                        ? json{{std::string(key.name), expected_in_schema(key)["default"]}}
                        : json::object());
    EXPECT_EQ(*good(plant.dump()).devices[1].options, absent) << protocol.name;
    EXPECT_EQ(absent, default_options(protocol)) << protocol.name;
  }
}

}  // namespace
}  // namespace fxagent
