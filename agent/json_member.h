// Members of JSON objects that other programs wrote. Pure. Any thread.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace fxagent {

/// nlohmann::json or ordered_json. Other types have functions of these names, too.
template <class Json>
concept JsonValue = requires {
  typename Json::json_pointer;
};

/// Returns the member `key`; null if it is absent, or if `object` is not an object.
template <JsonValue Json>
const Json& member(const Json& object, const char* key) {
  static const Json none;
  const auto found = object.is_object() ? object.find(key) : object.end();
  return found != object.end() ? *found : none;
}

/// Returns the text of a member; empty if it is not a string.
template <JsonValue Json>
std::string text_at(const Json& object, const char* key) {
  const Json& value = member(object, key);
  return value.is_string() ? value.template get<std::string>() : std::string();
}

}  // namespace fxagent
