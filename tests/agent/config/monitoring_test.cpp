// Devices whose protocol has a monitoring timer, and models whose device sets differ.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;
using nlohmann::json;

json plant(const std::string& device) {
  json whole = json::parse(small_plant().dump());
  whole["links"] =
      json::parse(R"([{"name": "eth1", "tcp": {"host": "192.0.2.20", "port": 5007}}])");
  json one = json::parse(R"({"name": "press1", "link": "eth1", "protocol": "mc-3e",
                             "model": "FX5U", "tags": [{"name": "a", "address": "D0"}]})");
  one.update(json::parse(device));
  whole["devices"] = json::array({one});
  return whole;
}

TEST(ConfigMonitoring, WhoWaitsForADeviceWaitsLongerThanItDoesItself) {
  const auto timeout = [](const std::string& device) {
    return good(plant(device).dump()).devices[0].timeout.count();
  };
  EXPECT_EQ(timeout("{}"), 5000);
  EXPECT_EQ(timeout(R"({"monitoring_timer_ms": 250})"), 1250);
  EXPECT_EQ(timeout(R"({"timeout_ms": 300})"), 300);
  EXPECT_TRUE(good(plant("{}").dump()).warnings.empty());
  EXPECT_TRUE(
      warns(good(plant(R"({"timeout_ms": 4000})").dump()),
            {"timeout_ms is not longer than the 4000 ms", "or monitoring_timer_ms shorter"}));
  EXPECT_TRUE(good(plant(R"({"timeout_ms": 4001})").dump()).warnings.empty());
}

TEST(ConfigMonitoring, AConnectionWhoseAnswersEndWithItIsNotListenedTo) {
  EXPECT_EQ(good(plant("{}").dump()).links[0].listening.count(), 0);
}

TEST(ConfigMonitoring, WithoutAModelOnlyWhatAllModelsCallAlikeIsTaken) {
  const auto tag = [](const std::string& address) {
    return plant(R"({"model": "auto", "tags": [{"name": "a", "address": ")" + address + R"("}]})")
        .dump(1);
  };
  const Config seven = good(tag("X7"));
  EXPECT_FALSE(warns(seven, {"is not in every model"}));
  expect_error(tag("X10"), "/devices/0/tags/0/address", {"octal", "`model` must be set"});
  good(tag("SD11999"));
  EXPECT_TRUE(warns(good(tag("ZR100000")), {"ZR100000", "is not in every model"}));
}

TEST(ConfigMonitoring, AnFx5IsPointedToTheProtocolsThatReachIt) {
  json other = plant(R"({"protocol": "modbus-tcp"})");
  other["devices"][0]["protocol"] = "fx-computer-link";
  expect_error(other.dump(1), "/devices/0/model", {"mc-3e", "mc-4c", "modbus-tcp"});
}

}  // namespace
}  // namespace fxagent
