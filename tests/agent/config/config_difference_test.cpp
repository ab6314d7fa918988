#include "agent/config/config_difference.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <random>

#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;
using Indices = std::vector<std::uint32_t>;

Config running() { return good(small_plant().dump()); }

/// The change from the small plant to the same with another value at `pointer`.
ConfigChange after_change(const std::string& pointer, const std::string& value) {
  return change_between(running(), good(changed(pointer, value)));
}

json device(const std::string& name, const std::string& link) {
  return {{"name", name},
          {"link", link},
          {"protocol", "fx-programming-port"},
          {"model", "FX3U"},
          {"tags", {{{"name", "level"}, {"address", "D7"}}}}};
}

TEST(ConfigDifference, SameTextChangesNothingAndSharesEveryDevice) {
  const Config before = running();
  const ConfigChange change = change_between(before, running());
  EXPECT_TRUE(change.empty());
  EXPECT_EQ(to_string(change, before), "nothing");
  for (std::size_t i = 0; i < before.devices.size(); ++i)
    EXPECT_TRUE(change.config.devices.shares(before.devices, i)) << i;
}

TEST(ConfigDifference, TextThatMeansTheSameChangesNothingButTheHash) {
  const Config before = running();
  json plant = small_plant();
  plant["devices"][0]["timeout_ms"] = config_key("devices[].timeout_ms").number();
  const ConfigChange change = change_between(before, good(plant.dump(2)));
  EXPECT_TRUE(change.empty());
  EXPECT_NE(change.config.hash, before.hash);
}

TEST(ConfigDifference, ChangedDeviceBeginsAnewAtItsPlaceAndItsLinkGoesOn) {
  const json changes = json::parse(R"({
    "/devices/0/timeout_ms": 900, "/devices/0/tags/0/address": "D101",
    "/devices/0/tags/0/unit": "bar", "/devices/0/tags/0/max": 7, "/devices/0/retries": 1,
    "/devices/0/model": "FX2N", "/devices/0/enquire": "never",
    "/devices/0/commands/allow": ["M100"]})");
  for (const auto& [pointer, value] : changes.items()) {
    const ConfigChange change = after_change(pointer, value.dump());
    EXPECT_EQ(change.devices_end, Indices{0}) << pointer;
    EXPECT_EQ(change.devices_begin, Indices{0}) << pointer;
    EXPECT_TRUE(change.links_end.empty() && change.links_begin.empty()) << pointer;
    EXPECT_TRUE(change.devices_adjusted.empty()) << pointer;
    EXPECT_EQ(to_string(change, running()).find("changed: 1 (press1)"), 0U) << pointer;
  }
}

TEST(ConfigDifference, DeviceOfOtherIntervalsGoesOn) {
  const Config before = running();
  for (const auto& [key, value] : std::map<std::string, std::string>{
           {"interval_ms", "300"}, {"publish", "\"on_change\""}, {"max_silent_s", "7"}}) {
    const ConfigChange change =
        change_between(before, good(changed("/devices/0/groups/0/" + key, value)));
    EXPECT_EQ(change.devices_adjusted, Indices{0}) << key;
    EXPECT_TRUE(change.devices_end.empty() && change.devices_begin.empty()) << key;
    EXPECT_FALSE(change.empty()) << key;
    EXPECT_FALSE(change.config.devices.shares(before.devices, 0)) << key;
    EXPECT_NE(std::as_const(change.config).devices[0].groups, before.devices[0].groups) << key;
    EXPECT_EQ(&std::as_const(change.config).devices[0].tags[0], &before.devices[0].tags[0])
        << key << ": two copies of the tags";
    EXPECT_EQ(to_string(change, before), "other poll settings: 1 (press1)") << key;
  }
}

TEST(ConfigDifference, DeviceWhoseGroupsAreOthersBeginsAnew) {
  json plant = small_plant();
  plant["devices"][0]["groups"][0]["name"] = "quick";
  plant["devices"][0]["tags"][0]["group"] = "quick";
  EXPECT_EQ(change_between(running(), good(plant.dump())).devices_begin, Indices{0});
  plant = small_plant();
  plant["devices"][0]["groups"].push_back({{"name", "slow"}, {"interval_ms", 5000}});
  EXPECT_EQ(change_between(running(), good(plant.dump())).devices_begin, Indices{0});
}

TEST(ConfigDifference, DeviceOfOtherIntervalsEndsWithItsLink) {
  json plant = small_plant();
  plant["devices"][0]["groups"][0]["interval_ms"] = 300;
  plant["links"][0]["serial"]["path"] = "/dev/ttyUSB1";
  const ConfigChange change = change_between(running(), good(plant.dump()));
  EXPECT_EQ(change.devices_end, Indices{0});
  EXPECT_EQ(change.devices_begin, Indices{0});
  EXPECT_TRUE(change.devices_adjusted.empty());
}

TEST(ConfigDifference, LinkThatListensForAnotherTimeIsAdjustedWhileItIsOpen) {
  const ConfigChange change = after_change("/devices/0/timeout_ms", "900");
  EXPECT_EQ(change.devices_end, Indices{0});
  EXPECT_EQ(change.links_adjusted, Indices{0});
  const ConfigChange share = after_change("/links/1/poll_share_percent", "50");
  EXPECT_EQ(share.links_adjusted, Indices{1});
  EXPECT_TRUE(share.devices_end.empty());
}

TEST(ConfigDifference, ChangedLinkBeginsAnewWithAllItsDevices) {
  const ConfigChange change = after_change("/links/0/serial/path", "\"/dev/ttyUSB1\"");
  EXPECT_EQ(change.links_end, Indices{0});
  EXPECT_EQ(change.links_begin, Indices{0});
  EXPECT_EQ(change.devices_end, Indices{0});
  EXPECT_EQ(change.devices_begin, Indices{0});
  EXPECT_EQ(change.config.devices[0].link, 0U);
}

TEST(ConfigDifference, AnotherLineBehindASerialServerBeginsItsLinkAnew) {
  for (const auto& [key, value] : std::map<std::string, std::string>{{"line_baud", "19200"},
                                                                     {"data_bits", "8"},
                                                                     {"parity", "\"none\""},
                                                                     {"stop_bits", "2"}}) {
    SCOPED_TRACE(key);
    const ConfigChange change = after_change("/links/1/" + key, value);
    EXPECT_EQ(change.links_end, Indices{1});
    EXPECT_EQ(change.links_begin, Indices{1});
    EXPECT_EQ(change.devices_end, Indices{1});
    EXPECT_EQ(change.devices_begin, Indices{1});
  }
}

TEST(ConfigDifference, PlaceOfWhatIsTakenOutIsVacantAndTheOthersKeepTheirs) {
  const Config before = running();
  json plant = small_plant();
  plant["devices"].erase(0);
  plant["links"].erase(0);
  const ConfigChange change = change_between(before, good(plant.dump()));
  EXPECT_EQ(change.links_end, Indices{0});
  EXPECT_EQ(change.devices_end, Indices{0});
  EXPECT_TRUE(change.devices_begin.empty());
  ASSERT_EQ(change.config.devices.size(), 2U);
  EXPECT_TRUE(change.config.devices[0].is_vacant());
  EXPECT_TRUE(change.config.links[0].is_vacant());
  EXPECT_TRUE(change.config.devices.shares(before.devices, 1));
  EXPECT_EQ(change.config.devices[1].link, 1U) << "though it is the first link of its file";
  EXPECT_EQ(change.devices_gone, std::vector<std::string>{"press1"});
  EXPECT_EQ(to_string(change, before), "gone: 1 (press1), links ended: 1");
}

TEST(ConfigDifference, NewDeviceTakesTheFirstVacantPlace) {
  const Config before = running();
  json plant = small_plant();
  plant["devices"].erase(0);
  plant["devices"].push_back(device("oven", "line1"));
  plant["devices"].push_back(device("saw", "line1"));
  const ConfigChange change = change_between(before, good(plant.dump()));
  EXPECT_EQ(change.devices_end, Indices{0});
  EXPECT_EQ(change.devices_begin, (Indices{0, 2}));
  EXPECT_EQ(change.config.devices[0].name, "oven");
  EXPECT_EQ(change.config.devices[1].name, "mixer");
  EXPECT_EQ(change.config.devices[2].name, "saw");
  EXPECT_EQ(change.devices_gone, std::vector<std::string>{"press1"});
  EXPECT_EQ(to_string(change, before), "new: 2 (oven saw), gone: 1 (press1)");
}

TEST(ConfigDifference, DeviceThatMovesToAnotherLinkBeginsAnew) {
  const ConfigChange change = after_change("/devices/1/link", "\"line1\"");
  EXPECT_EQ(change.devices_end, Indices{1});
  EXPECT_EQ(change.devices_begin, Indices{1});
  EXPECT_TRUE(change.devices_gone.empty());
  EXPECT_EQ(change.config.devices[1].link, 0U);
}

TEST(ConfigDifference, OtherOrderInTheFileIsNoChange) {
  const Config before = running();
  json plant = small_plant();
  std::swap(plant["devices"][0], plant["devices"][1]);
  std::swap(plant["links"][0], plant["links"][1]);
  EXPECT_TRUE(change_between(before, good(plant.dump())).empty());
}

TEST(ConfigDifference, OtherBrokerIsAChangeOfMqttAlone) {
  const ConfigChange change = after_change("/mqtt/servers/0", "\"mqtt://127.0.0.2\"");
  EXPECT_TRUE(change.mqtt);
  EXPECT_TRUE(change.devices_end.empty());
  EXPECT_EQ(to_string(change, running()), "mqtt");
}

TEST(ConfigDifference, IdentityAndStoreNeedARestartAndAreNamed) {
  const json changes = json::parse(R"({
    "/agent/id": "edge8", "/agent/root": "fx/plant-b", "/store/path": "/tmp",
    "/store/max_bytes": 1048576, "/store/max_age_h": 5, "/store/sync": "always",
    "/store/audit_max_bytes": 1048576, "/store/audit_max_age_h": 9})");
  for (const auto& [pointer, value] : changes.items()) {
    // The client id depends on the agent's id; a change would be a second finding.
    const auto errors = needs_restart(running(), good(changed(pointer, value.dump())));
    expect_error(errors, pointer, {"restart", "or put back"});
  }
  expect_error(needs_restart(running(), good(changed("/metrics", R"({"listen": "[::1]:9465"})"))),
               "/metrics/listen", {"restart", "the address at the start"});
  expect_error(needs_restart(good(without("/metrics")), running()), "/metrics/listen",
               {"restart", "no HTTP server"});
  EXPECT_TRUE(needs_restart(running(), running()).empty());
}

TEST(ConfigDifference, ErrorThatNeedsARestartHasTheLineOfTheSetting) {
  const auto line_of = [](const std::string& file, const std::string& begin) {
    return 1 + std::count(file.begin(), file.begin() + static_cast<long>(file.find(begin)), '\n');
  };
  const std::string other_id = changed("/agent/id", R"("edge8")");
  const auto errors = needs_restart(running(), good(other_id), other_id);
  ASSERT_EQ(errors.size(), 1U) << listed(errors);
  EXPECT_EQ(errors[0].line, line_of(other_id, "\"id\""));
  EXPECT_GT(errors[0].line, 1);
  EXPECT_EQ(needs_restart(running(), good(other_id)).at(0).line, 0) << "no file, no line";

  const Config with_size = good(changed("/store/max_bytes", "1048576"));
  const std::string without_size = small_plant().dump(1);
  EXPECT_EQ(needs_restart(with_size, running(), without_size).at(0).line,
            line_of(without_size, "\"store\""));
}

/// Classifies every key for a reload. A key that is missing here was forgotten.
TEST(ConfigDifference, EachKeyIsEitherTakenOverOrNeedsARestart) {
  const auto any_of = [](const std::string& words, const std::string& word) {
    return (" " + words + " ").find(" " + word + " ") != std::string::npos;
  };
  const std::string sections_taken_over =
      "mqtt mqtt.tls links[] links[].serial links[].serial.rs485 links[].tcp links[].udp devices[] "
      "devices[].groups[] devices[].tags[] devices[].commands";
  const std::string keys_taken_over =
      "agent.remote_config agent.remote_allow agent.remote_without_disk";
  const std::string restart =
      "metrics.listen http.listen http.hosts http.token_file agent.id agent.root store.path "
      "store.max_bytes store.max_age_h store.sync store.audit_max_bytes store.audit_max_age_h "
      "recorder.path recorder.link_bytes recorder.files recorder.max_bytes pair.member "
      "pair.quiet_ms";
  for (const ConfigKey& key : config_keys::kAll) {
    const std::string section(key.section);
    if (section.empty()) continue;
    if (section.starts_with("brokers[]") || section == "profiles[]") continue;  // needs_restart()
    const std::string path = section + "." + std::string(key.name);
    EXPECT_TRUE(any_of(sections_taken_over, section) || any_of(keys_taken_over, path) ||
                any_of(restart, path))
        << section << "." << key.name
        << ": compare it in config_difference.cpp, or let needs_restart() name it";
  }
}

/// Returns a random plant: some of a few names on some of a few links.
json random_plant(std::mt19937& random) {
  const auto chance = [&random](int of) {
    return std::uniform_int_distribution(0, of - 1)(random);
  };
  json plant = small_plant();
  plant["links"] = json::array();
  plant["devices"] = json::array();
  std::vector<std::string> links;
  for (const char* name : {"a", "b", "c", "d"}) {
    if (chance(3) == 0) continue;
    links.emplace_back(name);
    plant["links"].push_back({{"name", name},
                              {"tcp", {{"host", "192.0.2.1"}, {"port", 1000 + chance(2)}}},
                              {"poll_share_percent", 10 + chance(2)}});
  }
  std::shuffle(plant["links"].begin(), plant["links"].end(), random);
  for (int i = 0; i < 8 && !links.empty(); ++i) {
    if (chance(3) == 0) continue;
    json made = device("p" + std::to_string(i),
                       links[static_cast<std::size_t>(chance(static_cast<int>(links.size())))]);
    made["timeout_ms"] = 500 + chance(2);
    made["groups"] = {{{"name", "fast"}, {"interval_ms", 100 + chance(2)}}};
    made["tags"][0]["group"] = "fast";
    plant["devices"].push_back(made);
  }
  std::shuffle(plant["devices"].begin(), plant["devices"].end(), random);
  return plant;
}

TEST(ConfigDifference, WhateverChangesNothingThatGoesOnMovesAndNothingIsForgotten) {
  std::mt19937 random(7);
  Config now = good(random_plant(random).dump());
  for (int round = 0; round < 500; ++round) {
    const Config wanted = good(random_plant(random).dump());
    const ConfigChange change = change_between(now, wanted);
    const Config& next = change.config;
    const std::set<std::uint32_t> ends(change.devices_end.begin(), change.devices_end.end());
    const std::set<std::uint32_t> begins(change.devices_begin.begin(), change.devices_begin.end());
    for (std::uint32_t i = 0; i < now.devices.size(); ++i)
      if (!std::as_const(now).devices[i].is_vacant() && !ends.contains(i)) {
        ASSERT_NE(next.devices.shares(now.devices, i),
                  std::ranges::binary_search(change.devices_adjusted, i))
            << round;
        const std::uint32_t link = next.devices[i].link;
        ASSERT_EQ(now.links[link].channel, next.links[link].channel) << round;
      }
    std::set<std::string> names;
    for (std::uint32_t i = 0; i < next.devices.size(); ++i) {
      if (next.devices[i].is_vacant()) continue;
      ASSERT_TRUE(names.insert(next.devices[i].name).second) << round;
      ASSERT_FALSE(next.links[next.devices[i].link].is_vacant()) << round;
      const bool was = i < now.devices.size() && !std::as_const(now).devices[i].is_vacant();
      ASSERT_TRUE(begins.contains(i) || (was && !ends.contains(i))) << round;
    }
    for (const DeviceConfig& each : std::as_const(now).devices)
      ASSERT_EQ(std::ranges::count(change.devices_gone, each.name),
                each.is_vacant() || names.contains(each.name) ? 0 : 1)
          << round;
    // The change leads to the devices in the file.
    ASSERT_EQ(names.size(), wanted.devices.size()) << round;
    for (const DeviceConfig& each : wanted.devices) {
      const auto found = std::ranges::find(next.devices, each.name, &DeviceConfig::name);
      ASSERT_NE(found, next.devices.end()) << round;
      ASSERT_EQ(found->timeout, each.timeout) << round;
      ASSERT_EQ(found->groups, each.groups) << round;
      ASSERT_EQ(next.links[found->link].name, wanted.links[each.link].name) << round;
      ASSERT_EQ(next.links[found->link], wanted.links[each.link]) << round;
    }
    now = next;
  }
}

}  // namespace
}  // namespace fxagent
