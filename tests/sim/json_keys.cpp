#include "tests/sim/json_keys.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tests/sim/bytes.h"
#include "tests/sim/config.h"

namespace fxsim {

using nlohmann::json;

void fail(const std::string& where, const std::string& what) {
  throw ConfigError(where + ": " + what);
}

void expect_keys(const json& object, const Keys& known, const std::string& where) {
  if (!object.is_object()) fail(where, "an object is expected");
  for (const auto& [key, value] : object.items()) {
    if (std::ranges::find(known, key) != known.end()) continue;
    fail(where + "/" + key, "unknown key; known are: " + joined(known));
  }
}

std::int64_t number(const json& object, const char* key, std::int64_t fallback, std::int64_t least,
                    std::int64_t most, const std::string& where) {
  const auto found = object.find(key);
  if (found == object.end()) return fallback;
  const auto range = std::to_string(least) + " to " + std::to_string(most);
  if (!found->is_number_integer())
    fail(where + "/" + key, "an integer from " + range + " is expected");
  const auto value = found->get<std::int64_t>();
  if (value < least || value > most)
    fail(where + "/" + key, std::to_string(value) + " is not in " + range);
  return value;
}

std::chrono::milliseconds duration(const json& object, const char* key, int fallback,
                                   const std::string& where) {
  return std::chrono::milliseconds(number(object, key, fallback, 0, 3'600'000, where));
}

std::string text(const json& object, const char* key, std::string fallback,
                 const std::string& where) {
  const auto found = object.find(key);
  if (found == object.end()) return fallback;
  if (!found->is_string()) fail(where + "/" + key, "a text is expected");
  return found->get<std::string>();
}

bool flag(const json& object, const char* key, bool fallback, const std::string& where) {
  const auto found = object.find(key);
  if (found == object.end()) return fallback;
  if (!found->is_boolean()) fail(where + "/" + key, "true or false is expected");
  return found->get<bool>();
}

std::string required(const json& object, const char* key, const std::string& where) {
  auto value = text(object, key, "", where);
  if (value.empty()) fail(where + "/" + key, "is missing");
  return value;
}

}  // namespace fxsim
