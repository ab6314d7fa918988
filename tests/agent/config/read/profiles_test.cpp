#include "agent/config/read/sections.h"

#include <gtest/gtest.h>

#include <set>

#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;

/// The small plant with these profiles beside `json`, and a broker `cloud`.
std::string with_profiles(const std::string& more) {
  json plant = small_plant();
  plant["brokers"] = json::parse(R"([{"name": "cloud", "servers": ["mqtts://cloud.example"]}])");
  plant["profiles"] = json::parse(R"([{"kind": "json"}, {"kind": "json", "broker": "cloud"}])");
  if (!more.empty()) plant["profiles"].push_back(json::parse(more));
  return plant.dump(1);
}

TEST(ProfilesConfig, JsonAloneIsTheDefault) {
  EXPECT_TRUE(good(small_plant().dump()).profiles.empty());
  EXPECT_TRUE(good(changed("/profiles", R"([{"kind": "json"}])")).profiles.empty());
}

TEST(ProfilesConfig, BrokerThatNoProfileNamesIsWarnedOfWithTheKey) {
  json plant = json::parse(with_profiles(""));
  plant["profiles"] = json::parse(R"([{"kind": "json"}, {"kind": "thingsboard"}])");
  EXPECT_TRUE(
      warns(good(plant.dump()), {"to the broker cloud: one must have \"broker\": \"cloud\""}));
}

TEST(ProfilesConfig, BrokersHaveTheKeysOfMqtt) {
  const Config config = good(with_profiles(""));
  ASSERT_EQ(config.brokers.size(), 1U);
  EXPECT_EQ(config.brokers[0].mqtt.servers, std::vector<std::string>{"mqtts://cloud.example:8883"});
  EXPECT_EQ(config.brokers[0].mqtt.client_id, "fx-edge7");
  EXPECT_EQ(config.brokers[0].mqtt.keep_alive, config.mqtt.keep_alive);
  EXPECT_FALSE(config.brokers[0].commands);
  ASSERT_EQ(config.profiles.size(), 1U);
  EXPECT_EQ(name_of(config.profiles[0]), "json@cloud");
}

TEST(ProfilesConfig, SparkplugTakesItsNodeFromTheAgent) {
  const Config config = good(with_profiles(R"({"kind": "sparkplug", "group": "Plant A"})"));
  EXPECT_EQ(config.profiles[1].group, "Plant A");
  EXPECT_EQ(config.profiles[1].node, "edge7");
  EXPECT_EQ(name_of(config.profiles[1]), "sparkplug");
}

TEST(ProfilesConfig, TypedCommandsAreAProfileBesideTheirSparkplug) {
  const Config config = good(with_profiles(
      R"({"kind": "sparkplug", "group": "a", "host": "scada", "old_state": true, "commands": true})"));
  ASSERT_EQ(config.profiles.size(), 3U);
  EXPECT_EQ(name_of(config.profiles[1]), "sparkplug");
  const ProfileConfig& typed = config.profiles[2];
  EXPECT_EQ(name_of(typed), "sparkplug-commands");
  EXPECT_EQ(typed.group + " " + typed.node + " " + typed.host, "a edge7 scada");
  EXPECT_FALSE(typed.old_state);
  const std::string there =
      R"({"kind": "sparkplug", "group": "a", "broker": "cloud", "commands": true})";
  expect_error(with_profiles(there), "/profiles/2/commands", {"cloud", "\"commands\": true"});
  json plant = json::parse(with_profiles(there));
  plant["brokers"][0]["commands"] = true;
  EXPECT_EQ(name_of(good(plant.dump()).profiles.back()), "sparkplug-commands@cloud");
}

TEST(ProfilesConfig, PlainNamesOfThePlantStandInTheTopic) {
  const Config config = good(with_profiles(
      R"({"kind": "plain", "topic": "{site}/{area}/{line}/{device}/{tag}", "site": "Ulm",
          "area": "press shop", "line": "L1"})"));
  EXPECT_EQ(config.profiles[1].topic, "Ulm/press shop/L1/{device}/{tag}");
}

TEST(ProfilesConfig, ANameOfThePlantMayStandTwice) {
  const Config config = good(with_profiles(
      R"({"kind": "plain", "topic": "{site}/{site}/{device}/{site}_{tag}", "site": "Ulm"})"));
  EXPECT_EQ(config.profiles.at(1).topic, "Ulm/Ulm/{device}/Ulm_{tag}");
}

TEST(ProfilesConfig, EachFaultNamesItsPlaceAndItsCure) {
  const std::string place = "/profiles/2";
  expect_error(with_profiles(R"({"kind": "opc"})"), place + "/kind", {"json", "plain"});
  expect_error(with_profiles(R"({"kind": "plain", "broker": "clod"})"), place + "/broker",
               {"no broker", "the name clod", "did you mean cloud?"});
  expect_error(with_profiles(R"({"kind": "json"})"), place, {"twice", "same broker"});
  expect_error(with_profiles(R"({"kind": "sparkplug"})"), place, {"needs group"});
  expect_error(with_profiles(R"({"kind": "sparkplug", "group": "a/b"})"), place + "/group",
               {"must not have"});
  expect_error(with_profiles(R"({"kind": "plain", "commands": true})"), place + "/commands",
               {"belongs to the kind sparkplug"});
  expect_error(with_profiles(R"({"kind": "plain", "group": "a"})"), place + "/group",
               {"belongs to the kind sparkplug"});
  expect_refused("/profiles", R"([{"kind": "plain"}])", {"needs", "json"});
}

TEST(ProfilesConfig, EachTagNeedsATopicOfItsOwn) {
  const auto topic = [](const std::string& text) {
    return with_profiles(R"({"kind": "plain", "topic": ")" + text + "\"}");
  };
  const std::string place = "/profiles/2/topic";
  expect_error(topic("{root}/{id}/{device}"), place, {"needs {tag}"});
  expect_error(topic("a/{tags}"), place, {"has {tags}", "{tag}"});
  expect_error(topic("a/{tag"), place, {"{ without a }"});
  expect_error(topic("a/+/{tag}"), place, {"wildcards"});
  expect_error(topic("/a/{tag}"), place, {"empty level"});
  expect_error(topic("$a/{tag}"), place, {"$"});
  expect_error(topic("{site}/{tag}"), "/profiles/2", {"{site}", "set site"});
  json plant = json::parse(topic("a/{tag}"));
  plant["devices"][1]["tags"] = {{{"name", "temp"}, {"address", "D1"}}};
  expect_error(plant.dump(), place, {"temp of mixer", "another tag has", "{device}"});
  plant = json::parse(with_profiles(R"({"kind": "plain"})"));
  plant["devices"][0]["tags"][0]["name"] = "state";
  expect_error(plant.dump(), "/profiles/2", {"state of press1", "the agent uses itself"});
  plant = json::parse(with_profiles(R"({"kind": "plain"})"));
  plant["devices"][1]["tags"] = {{{"name", "temp"}, {"address", "D1"}, {"group", "slow"}}};
  expect_error(plant.dump(), "/devices/1/tags/0/group", {"no group \"slow\""});
}

TEST(ProfilesConfig, WrongNamesAreReportedOnce) {
  const auto pointers = [](const std::string& device, const std::string& tags) {
    json plant = json::parse(with_profiles(R"({"kind": "plain"})"));
    plant["devices"][1]["name"] = device;
    plant["devices"][0]["tags"] = plant["devices"][1]["tags"] = json::parse(tags);
    std::set<std::string> places;
    for (const ConfigError& error : errors_of(plant.dump(), environment()))
      places.insert(error.pointer);
    return places;
  };
  EXPECT_EQ(
      pointers("mixer", R"([{"name": "A", "address": "D0"}, {"name": "B", "address": "D1"}])"),
      (std::set<std::string>{"/devices/0/tags/0/name", "/devices/0/tags/1/name",
                             "/devices/1/tags/0/name", "/devices/1/tags/1/name"}));
  EXPECT_EQ(
      pointers("mixer", R"([{"name": "a", "address": "D0"}, {"name": "a", "address": "D1"}])"),
      (std::set<std::string>{"/devices/0/tags/1/name", "/devices/1/tags/1/name"}));
  EXPECT_EQ(pointers("press1", R"([{"name": "a", "address": "D0"}])"),
            std::set<std::string>{"/devices/1/name"});
}

TEST(ProfilesConfig, ThingsBoardOnTheBrokerOfMqttIsWarnedOf) {
  EXPECT_TRUE(warns(good(with_profiles(R"({"kind": "thingsboard"})")),
                    {"ThingsBoard does not accept the topics of json", "brokers"}));
  EXPECT_FALSE(
      warns(good(with_profiles(R"({"kind": "thingsboard", "broker": "cloud"})")), {"ThingsBoard"}));
}

TEST(ProfilesConfig, ThingsBoardNeedsAKeyForEachValue) {
  json plant = json::parse(with_profiles(R"({"kind": "thingsboard", "broker": "cloud"})"));
  const auto with_tags = [&](const std::string& tags) {
    plant["devices"][0]["tags"] = json::parse(tags);
    return plant.dump();
  };
  good(with_tags(R"([{"name": "a", "address": "D1"}, {"name": "a_0", "address": "D2"},
                     {"name": "b", "address": "D10", "count": 3}, {"name": "b_3", "address": "D4"},
                     {"name": "b_00", "address": "D5"}, {"name": "c_bad", "address": "D6"}])"));
  expect_error(with_tags(R"([{"name": "a", "address": "D1"}, {"name": "a_bad", "address": "D2"}])"),
               "/profiles/2", {"a_bad of press1", "rename"});
  expect_error(with_tags(R"([{"name": "a_2", "address": "D1"},
                             {"name": "a", "address": "D2", "count": 3}])"),
               "/profiles/2", {"a_2 of press1", "the tag a:"});
}

}  // namespace
}  // namespace fxagent
