#include "agent/uplink/profile/homeassistant_profile.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "protocol/modbus/modbus.h"
#include "tests/agent/uplink/plant.h"

namespace fxagent::test {
namespace {

using Json = nlohmann::json;

const std::string kPress1 = "homeassistant/device/fx_plant-a_edge7_press1/config";
const std::string kPress2 = "homeassistant/device/fx_plant-a_edge7_press2/config";

struct HomeAssistant : testing::Test {
  void begin(HearsCommands hears = HearsCommands::yes) {
    ProfileConfig settings;
    settings.kind = ProfileConfig::Kind::homeassistant;
    settings.prefix = "homeassistant";
    profile_ = std::make_unique<HomeAssistantProfile>(config_, settings, "1.2.3", hears);
    profile_->connection_began({});
  }
  std::vector<Publication> publish() {
    std::vector<Publication> all;
    while (true) {
      auto due = profile_->due(SteadyTime{}, 0);
      if (due.empty()) return all;
      EXPECT_EQ(due.size(), 1U);
      EXPECT_EQ(due.front().retain, Retain::yes);
      all.push_back(std::move(due.front()));
    }
  }
  /// Publishes all that is due. Returns the last payload of each topic.
  std::map<std::string, std::string> retained() {
    std::map<std::string, std::string> last;
    for (const Publication& each : publish()) last[each.topic] = each.payload;
    return last;
  }
  Json components(const std::string& topic = kPress1) {
    return Json::parse(retained().at(topic)).at("components");
  }
  void hear(const std::string& topic, const std::string& payload) {
    profile_->hear(test::message_on(topic, payload));
  }
  /// Changes to `wanted` as a reload does.
  void reload(Config wanted) {
    ConfigChange change = change_between(config_, std::move(wanted));
    config_ = std::move(change.config);
    profile_->change(change);
  }
  std::set<std::string> topics() {
    std::set<std::string> topics;
    for (const Publication& each : publish()) topics.insert(each.topic);
    return topics;
  }

  Config config_ = plant();
  std::unique_ptr<HomeAssistantProfile> profile_;
};

TEST_F(HomeAssistant, EachDeviceHasOneRetainedMessage) {
  begin();
  const auto all = retained();
  ASSERT_EQ(all.size(), 2U);
  const Json press = Json::parse(all.at(kPress1));
  EXPECT_EQ(press.at("origin"), (Json{{"name", "fxagent"}, {"sw_version", "1.2.3"}}));
  EXPECT_EQ(press.at("device").at("identifiers"), Json({"fx_plant-a_edge7_press1"}));
  EXPECT_EQ(press.at("availability").at(0).at("topic"), "fx/plant-a/edge7/state");
  EXPECT_EQ(press.at("availability").at(1).at("topic"), "fx/plant-a/edge7/press1/state");
  EXPECT_TRUE(publish().empty());
  EXPECT_FALSE(profile_->wants_samples());
}

TEST_F(HomeAssistant, PlatformsFollowTypeAndAccess) {
  auto& tags = config_.devices[0].tags;
  TagConfig lamp = tag("lamp", "M1", DataType::boolean);
  lamp.writable = true;
  TagConfig mode = tag("mode", "D500", DataType::int16);
  mode.units = std::make_shared<const TagUnits>(TagUnits{.states = {{0, "off"}, {1, "None"}}});
  TagConfig stage = mode;
  stage.name = "stage";
  mode.writable = true;
  TagConfig recipe = tag("recipe", "D510", DataType::string);
  recipe.point.length = 6;
  recipe.writable = true;
  tags = {tags[temp], tags[running], tags[setpoint], tags[label], lamp, mode, stage, recipe};
  config_.devices[0].commands.allow_run_stop = true;
  begin();
  const Json found = components();
  std::set<std::string> keys;
  for (const auto& [key, component] : found.items()) keys.insert(key);
  EXPECT_EQ(keys,
            (std::set<std::string>{"sensor_temp", "binary_sensor_running", "number_setpoint",
                                   "sensor_label", "switch_lamp", "select_mode", "sensor_stage",
                                   "text_recipe", "button_run", "button_stop"}));
  EXPECT_EQ(found.at("number_setpoint").at("min"), 0);
  EXPECT_EQ(found.at("number_setpoint").at("max"), 1000);
  EXPECT_EQ(found.at("select_mode").at("options"), Json({"off", "(None)"}));
  EXPECT_EQ(found.at("sensor_stage").at("device_class"), "enum");
  EXPECT_EQ(found.at("text_recipe").at("max"), 6);
  EXPECT_EQ(found.at("sensor_temp").at("unit_of_measurement"), "°C");

  begin(HearsCommands::no);
  const Json read_only = components();
  for (const auto& [key, component] : read_only.items()) {
    EXPECT_TRUE(key.starts_with("sensor_") || key.starts_with("binary_sensor_")) << key;
    EXPECT_FALSE(component.contains("command_topic")) << key;
  }
}

TEST_F(HomeAssistant, ProtocolWithoutRunAndStopHasNoButtons) {
  config_.devices[0].commands.allow_run_stop = true;
  config_.devices[0].codec = std::make_shared<const modbus::Modbus>(modbus::Modbus::Settings{});
  begin();
  const Json found = components();
  for (const auto& [key, component] : found.items())
    EXPECT_FALSE(key.starts_with("button_")) << key;
}

TEST_F(HomeAssistant, ArrayHasAnEntityForEachOfTheFirst64Elements) {
  TagConfig array = tag("a", "D600", DataType::int16);
  array.point.is_array = true;
  array.point.count = 100;
  array.writable = true;
  config_.devices[0].tags = {array, tag("a_0", "D700", DataType::int16)};
  begin();
  const Json found = components();
  EXPECT_EQ(found.size(), 65U);
  EXPECT_TRUE(found.contains("sensor_a_63"));
  std::set<std::string> ids;
  for (const auto& [key, component] : found.items())
    ids.insert(component.at("unique_id").get<std::string>());
  EXPECT_EQ(ids.size(), 65U);
}

TEST_F(HomeAssistant, NoTwoDevicesShareAnObjectId) {
  config_.devices = {press("a_b"), press("a-b"), press("axb"), press("ax5fb"), press("a__b")};
  begin();
  EXPECT_EQ(retained().size(), 5U);
}

TEST_F(HomeAssistant, BirthOfHomeAssistantHasAllAgain) {
  begin();
  publish();
  hear("homeassistant/status", "offline");
  EXPECT_TRUE(publish().empty());
  hear("homeassistant/status", "online");
  hear("homeassistant/status", "online");
  EXPECT_EQ(publish().size(), 2U);
}

TEST_F(HomeAssistant, ModelOfThePlcIsPublishedOnce) {
  begin();
  publish();
  DeviceStatus status = offline(0, "starting");
  status.model = "FX3U";
  profile_->device_state(status);
  EXPECT_EQ(topics(), std::set<std::string>{kPress1});
  profile_->device_state(status);
  EXPECT_TRUE(publish().empty());
}

TEST_F(HomeAssistant, OwnMessagesChangeNothing) {
  begin();
  const auto first = publish();
  for (const Publication& each : first) hear(each.topic, each.payload);
  EXPECT_TRUE(publish().empty());
}

TEST_F(HomeAssistant, ClearsOnlyItsOwnLeftovers) {
  begin();
  const std::string ours = retained().at(kPress1);
  const std::string begin = "homeassistant/device/fx_plant-a_edge7_";
  hear(begin + "gone/config", ours);
  hear(begin + "gone_x/config", ours);                            // its root is our base
  hear("homeassistant/device/fx_plant-a_edge70_x/config", ours);  // another agent
  hear(begin + "lamp/config", R"({"origin":{"name":"other"},"components":{}})");
  hear(begin + "empty/config", "");
  hear("homeassistant/device/config", ours);
  hear("homeassistant/device//config", ours);
  const auto all = publish();
  ASSERT_EQ(all.size(), 1U);
  EXPECT_EQ(all[0].topic, begin + "gone/config");
  EXPECT_EQ(all[0].payload, "");
}

TEST_F(HomeAssistant, RemovesEntitiesOfAnEarlierRun) {
  begin();
  const std::string before = retained().at(kPress1);
  config_.devices[0].tags = {config_.devices[0].tags[setpoint]};
  begin();
  hear(kPress1, before);
  std::vector<Json> messages;
  for (const Publication& each : publish())
    if (each.topic == kPress1) messages.push_back(Json::parse(each.payload).at("components"));
  ASSERT_EQ(messages.size(), 2U);
  EXPECT_EQ(messages[0].at("sensor_temp"), (Json{{"platform", "sensor"}}));
  EXPECT_EQ(messages[1].size(), 1U);
  hear(kPress1, "{\"origin\":{\"name\":\"fxagent\",\"x\":1},\"components\":[1,{\"a\":2},null]}");
  hear(kPress1, "{\"origin\":{\"name\":\"fxagent\",");
  EXPECT_TRUE(publish().empty());
}

TEST_F(HomeAssistant, ReloadClearsRemovedDevicesAndEntities) {
  begin();
  publish();
  Config next = plant();
  next.devices = {press("press2"), press("press3")};
  next.devices[0].tags = {next.devices[0].tags[setpoint]};
  reload(next);
  const auto all = publish();
  ASSERT_EQ(all.size(), 4U);
  EXPECT_EQ(all[0].topic, kPress1);
  EXPECT_EQ(all[0].payload, "");
  std::map<std::string, std::vector<Json>> found;
  for (std::size_t i = 1; i < all.size(); ++i)
    found[all[i].topic].push_back(Json::parse(all[i].payload).at("components"));
  EXPECT_EQ(found.at(kPress2).at(0).at("binary_sensor_running"),
            (Json{{"platform", "binary_sensor"}}));
  EXPECT_EQ(found.at(kPress2).at(1).size(), 1U);
  // It comes back before the connection does.
  profile_->connection_ended();
  next.devices = {press("press2")};
  reload(next);
  next.devices = {press("press2"), press("press3")};
  reload(next);
  profile_->connection_began({});
  for (const auto& [topic, payload] : retained()) EXPECT_FALSE(payload.empty()) << topic;
}

}  // namespace
}  // namespace fxagent::test
