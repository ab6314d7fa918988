// Tests the table of keys against the loader and the examples of docs/config/examples.md.
#include "agent/config/keys.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "protocol/catalog.h"
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

/// The sections in the order of docs/config/keys.md.
std::vector<std::string> sections() {
  std::vector<std::string> list;
  for (const ConfigKey& key : config_keys::kAll)
    if (list.empty() || list.back() != key.section) list.emplace_back(key.section);
  return list;
}

/// `{KEY: default}`, or an empty object if the key has none.
json with_default(const ConfigKey& key) {
  json out = json::object();
  std::visit(Overload{[](ConfigKey::None) {}, [](ConfigKey::Required) {}, [](ConfigKey::Rule) {},
                      [&](const auto& value) { out[std::string(key.name)] = value; }},
             key.fallback);
  return out;
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

// ---- the page -------------------------------------------------------------------------------

TEST(ConfigKeys, ExamplesHaveTheSmallestFileOfEachProtocol) {
  std::ifstream file(FXAGENT_CONFIG_DIR "/../docs/config/examples.md");
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

/// What an absent key comes to must be what the same key comes to when its default is given.
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
  EXPECT_EQ(config.mqtt.reconnect_spread.count(), number(config_key("mqtt.reconnect_spread_s")));
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

  // The same where the section itself is absent, so that it needs no code of its own.
  plant.erase("store");
  plant["agent"].erase("root");
  const Config bare = good(plant.dump());
  EXPECT_EQ(bare.root, config_key("agent.root").word());
  EXPECT_EQ(bare.store.max_age, config.store.max_age);
}

/// Options fall back to what the codec itself has, so that no default stands in both.
TEST(ConfigKeys, OptionsGivenWithTheirDefaultsChangeNothing) {
  for (const ProtocolInfo& protocol : catalog()) {
    json plant = small_plant();
    json& device = plant["devices"][1];
    device = {{"name", "mixer"}, {"link", "gw1"}, {"protocol", protocol.name}};
    const Options absent = *good(plant.dump()).devices[1].options;
    for (const ConfigKey& key : protocol_keys(protocol)) device.update(with_default(key));
    EXPECT_EQ(*good(plant.dump()).devices[1].options, absent) << protocol.name;
    EXPECT_EQ(absent, default_options(protocol)) << protocol.name;
  }
}

}  // namespace
}  // namespace fxagent
