// The small plant as a local file that permits remote configs, and documents for it.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "agent/config/loader.h"
#include "agent/remote/desired_config.h"
#include "tests/agent/config/small_plant.h"

namespace fxagent::test {

using nlohmann::json;

inline json local_plant() {
  json plant = small_plant();
  plant["agent"]["remote_config"] = true;
  plant["mqtt"]["username"] = "edge7";
  plant["mqtt"]["password"] = "s3cret";
  plant["mqtt"]["allow_plain_secret"] = true;
  plant["devices"][0]["tags"].push_back(
      {{"name", "setpoint"}, {"address", "D200"}, {"access", "read_write"}, {"max", 100}});
  return plant;
}

inline json local_plant(const json& remote_allow) {
  json plant = local_plant();
  plant["agent"]["remote_allow"] = remote_allow;
  return plant;
}

inline DesiredConfig desired_of(const json& document) {
  ReadDesired read = read_desired(document.dump());
  EXPECT_TRUE(read.errors.empty()) << listed(read.errors);
  return read.desired;
}
inline DesiredConfig config_of(const json& config) {
  return desired_of({{"version", "v1"}, {"config", config}});
}
inline DesiredConfig patch_of(const json& patch) {
  return desired_of({{"version", "v1"}, {"patch", patch}});
}

/// The effective config, or its errors.
inline tl::expected<Config, ConfigErrors> effective(const json& local,
                                                    const DesiredConfig& desired) {
  const std::string text = local.dump();
  return effective_config(text, good(text), desired, [](std::string_view merged) {
    return parse_config(merged, environment({{"HOST", "inner"}}));
  });
}

inline ConfigErrors errors_of(const json& local, const DesiredConfig& desired) {
  const auto config = effective(local, desired);
  return config ? ConfigErrors{} : config.error();
}

}  // namespace fxagent::test
