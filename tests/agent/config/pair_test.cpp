// The section `pair`.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;

std::string with_pair(const std::string& member, const std::string& more = "") {
  return changed("/pair", R"({"member": ")" + member + '"' + more + "}");
}

TEST(ConfigPair, MemberIsAName) {
  EXPECT_EQ(good(with_pair("a")).pair->member, "a");
  for (const char* member : {"Gateway A", "GatewayA", "gw.a", "a/b", "+", "#", "\u00e4", ""})
    expect_error(with_pair(member), "/pair/member", {});
  expect_error(with_pair("state"), "/pair", {"a level of other topics"});
}

TEST(ConfigPair, NeedsWhatATakeoverNeeds) {
  auto plant = nlohmann::json::parse(with_pair("a"));
  plant.erase("store");
  expect_error(plant.dump(1), "/pair", {"needs a store"});
  plant = nlohmann::json::parse(with_pair("a"));
  plant["mqtt"]["version"] = "3.1.1";
  expect_error(plant.dump(1), "/pair", {"needs MQTT 5"});
  plant = nlohmann::json::parse(with_pair("a"));
  plant["agent"]["remote_config"] = true;
  expect_error(plant.dump(1), "/pair", {"no remote config", "the files of both"});
}

TEST(ConfigPair, SlowDevicesAreNamedWithTheNumbersThatFit) {
  std::string warnings;
  for (const std::string& warning : good(with_pair("a", R"(, "quiet_ms": 1500)")).warnings)
    warnings += warning;
  EXPECT_NE(warnings.find("timeout_ms 750 or less, or quiet_ms 2000 or more"), warnings.npos)
      << warnings;
  EXPECT_TRUE(good(with_pair("a", R"(, "quiet_ms": 2000)")).warnings.empty());
  auto plant = nlohmann::json::parse(with_pair("a", R"(, "quiet_ms": 1500)"));
  nlohmann::json second = plant["devices"][0];
  second["name"] = "second";
  second["timeout_ms"] = 1200;
  plant["devices"].push_back(second);
  EXPECT_TRUE(warns(good(plant.dump()), {"an answer of press1, mixer, second may come",
                                         "timeout_ms 750 or less, or quiet_ms 2400 or more"}));
  plant["links"].push_back({{"name", "eth"}, {"tcp", {{"host", "192.0.2.20"}, {"port", 5007}}}});
  plant["devices"] = nlohmann::json::parse(R"([{"name": "press1", "link": "eth",
      "protocol": "mc-3e", "model": "FX5U", "tags": [{"name": "a", "address": "D0"}]}])");
  EXPECT_TRUE(warns(good(plant.dump()), {"750 or less (and monitoring_timer_ms shorter"}));
}

}  // namespace
}  // namespace fxagent
