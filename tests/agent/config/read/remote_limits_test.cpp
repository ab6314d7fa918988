#include "agent/config/read/sections.h"

#include <gtest/gtest.h>

#include "agent/config/config_difference.h"
#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;

std::string with_allow(const std::string& list) {
  return changed("/agent",
                 R"({"id": "edge7", "remote_config": true, "remote_allow": )" + list + "}");
}

TEST(RemoteLimits, NothingIsSetRemotelyUnlessTheFileSaysSo) {
  EXPECT_FALSE(good(small_plant().dump()).remote.enabled);
}

TEST(RemoteLimits, WithoutAListLinksAndDevicesMayCome) {
  const Config config = good(changed("/agent/remote_config", "true"));
  EXPECT_TRUE(config.remote.enabled);
  EXPECT_FALSE(config.remote.without_disk);
  EXPECT_EQ(to_string(config.remote), "links, devices");
}

TEST(RemoteLimits, TheListIsAllThatMayCome) {
  EXPECT_EQ(to_string(good(with_allow(R"(["devices"])")).remote), "devices");
  EXPECT_EQ(to_string(good(with_allow("[]")).remote), "nothing");
  EXPECT_EQ(to_string(good(with_allow(R"(["links", "mqtt.servers", "commands.allow_run_stop",
                                          "commands.allow: D300-D399", "commands.allow:hr:0-hr:9",
                                          "commands.allow: mc-3e  FX5U  Y0-Y17",
                                          "commands.allow: modbus-tcp hr:5"])"))
                          .remote),
            "links, mqtt.servers, commands.allow_run_stop, commands.allow D300-D399, "
            "commands.allow hr:0-hr:9, commands.allow mc-3e FX5U Y0-Y17, "
            "commands.allow modbus-tcp hr:5");
}

TEST(RemoteLimits, WhatNeverComesIsRefusedWithWhatMay) {
  struct Case {
    const char* word;
    const char* said;
  };
  for (const Case& each : std::vector<Case>{
           {"mqtt", "cannot be set remotely; these can: links, devices"},
           {"mqtt.password", "cannot be set remotely"},
           {"store.path", "cannot be set remotely"},
           {"agent.remote_allow", "cannot be set remotely"},
           {"metrics", "cannot be set remotely"},
           {"device", "did you mean devices?"},
           {"commands.allow", "needs the addresses, as in"},
           {"commands.allow: ", "is not a range of addresses"},
           {"commands.allow: D99999999", "is not a range of addresses"},
           {"commands.allow: Q100", "is not a range of addresses"},
           {"commands.allow: mc-3e", "needs a model of mc-3e after the protocol, FX5U"},
           {"commands.allow: mc-3e Y0-Y17", "needs a model of mc-3e"},
           {"commands.allow: mc-3e auto Y0-Y17", "needs a model of mc-3e"},
           {"commands.allow: mc-3e FX5U", "is not a range of addresses of mc-3e FX5U"},
           {"commands.allow: mc-3e FX5U Y18", "is not a range of addresses of mc-3e FX5U"},
           {"commands.allow: modbus-tcp D5", "is not a range of addresses of modbus-tcp"},
           {"templates", "must be links, devices"},
       }) {
    SCOPED_TRACE(each.word);
    expect_error(with_allow("[\"" + std::string(each.word) + "\"]"), "/agent/remote_allow/0",
                 {each.said});
  }
  EXPECT_EQ(errors_of(with_allow("[7]")).size(), 1u);
  EXPECT_EQ(errors_of(with_allow("\"links\"")).size(), 1u);
}

TEST(RemoteLimits, AListThatHasNoEffectIsWarnedOf) {
  const Config config = good(changed("/agent/remote_allow", R"(["links"])"));
  ASSERT_FALSE(config.warnings.empty());
  EXPECT_NE(config.warnings[0].find("no effect without \"remote_config\""), std::string::npos);
}

TEST(RemoteLimits, OtherLimitsAreAChangeThatNeedsNoRestart) {
  const Config off = good(small_plant().dump());
  const Config on = good(changed("/agent/remote_config", "true"));
  EXPECT_TRUE(needs_restart(off, on).empty());
  const ConfigChange change = change_between(off, on);
  EXPECT_FALSE(change.empty());
  EXPECT_TRUE(change.remote);
  EXPECT_FALSE(change.mqtt);
}

}  // namespace
}  // namespace fxagent
