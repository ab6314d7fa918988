// A valid config, and functions that introduce a single error.
#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "agent/config/loader.h"

namespace fxagent::test {

/// One serial and one TCP link with a device each; has every section.
inline nlohmann::json small_plant() {
  return nlohmann::json::parse(R"({
    "agent": {"id": "edge7", "root": "fx/plant-a"},
    "mqtt": {"servers": ["mqtt://127.0.0.1:1883"]},
    "store": {"path": "/var/lib/fxagent"},
    "metrics": {"listen": "127.0.0.1:9464"},
    "links": [
      {"name": "line1", "serial": {"path": "/dev/ttyUSB0"}},
      {"name": "gw1", "tcp": {"host": "192.0.2.10", "port": 5551}, "line_baud": 9600}
    ],
    "devices": [
      {"name": "press1", "link": "line1", "protocol": "fx-programming-port", "model": "FX3U",
       "groups": [{"name": "fast", "interval_ms": 200}],
       "tags": [
         {"name": "temp", "address": "D100", "group": "fast"},
         {"name": "running", "address": "M0", "type": "bool"}
       ],
       "commands": {"allow": ["M100-M199", "Y0-Y7"]}},
      {"name": "mixer", "link": "gw1", "protocol": "fx-programming-port", "model": "FX2N"}
    ]
  })");
}

/// The small plant with the value at `pointer` set to the JSON `value`.
inline std::string changed(const std::string& pointer, const std::string& value) {
  nlohmann::json plant = small_plant();
  plant[nlohmann::json::json_pointer(pointer)] = nlohmann::json::parse(value);
  return plant.dump(1);
}

/// The small plant without the member at `pointer`.
inline std::string without(const std::string& pointer) {
  return small_plant()
      .patch(nlohmann::json::array({{{"op", "remove"}, {"path", pointer}}}))
      .dump(1);
}

/// The small plant with the first device's first tag replaced.
inline std::string with_tag(const std::string& tag) { return changed("/devices/0/tags/0", tag); }

inline Environment environment(std::map<std::string, std::string, std::less<>> variables = {}) {
  return [variables = std::move(variables)](std::string_view name) -> std::optional<std::string> {
    const auto found = variables.find(name);
    return found == variables.end() ? std::nullopt : std::optional(found->second);
  };
}

inline std::vector<ConfigError> errors_of(std::string_view text, const Environment& from) {
  const auto config = parse_config(text, from);
  return config ? std::vector<ConfigError>{} : config.error();
}
inline std::vector<ConfigError> errors_of(std::string_view text) {
  return errors_of(text, environment());
}

/// Formats all errors as lines of text, for messages and searching.
inline std::string listed(const std::vector<ConfigError>& errors) {
  std::string text;
  for (const ConfigError& error : errors) text += to_string(error, "agent.json") + "\n";
  return text;
}

/// Parses a config that must be valid.
inline Config good(std::string_view text, const Environment& from) {
  auto config = parse_config(text, from);
  if (config) return std::move(*config);
  ADD_FAILURE() << listed(config.error());
  return {};
}
inline Config good(std::string_view text) { return good(text, environment()); }

/// Expects exactly one error, at `pointer`, whose text has every one of `words`.
inline void expect_error(const std::vector<ConfigError>& errors, const std::string& pointer,
                         const std::vector<std::string>& words) {
  ASSERT_EQ(errors.size(), 1U) << listed(errors);
  EXPECT_EQ(errors[0].pointer, pointer) << errors[0].text;
  for (const std::string& word : words)
    EXPECT_NE(errors[0].text.find(word), std::string::npos)
        << "no \"" << word << "\" in: " << errors[0].text;
}
inline void expect_error(std::string_view text, const std::string& pointer,
                         const std::vector<std::string>& words) {
  expect_error(errors_of(text), pointer, words);
}

/// Expects exactly one error at `pointer` in the small plant with the JSON `value` there.
inline void expect_refused(const std::string& pointer, const std::string& value,
                           const std::vector<std::string>& words) {
  SCOPED_TRACE(pointer + " = " + value);
  expect_error(changed(pointer, value), pointer, words);
}

/// True if one of the config's warnings contains all the words.
inline bool warns(const Config& config, const std::vector<std::string>& words) {
  for (const std::string& warning : config.warnings) {
    bool all = true;
    for (const std::string& word : words) all = all && warning.find(word) != std::string::npos;
    if (all) return true;
  }
  return false;
}

}  // namespace fxagent::test
