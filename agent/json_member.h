// Members of JSON objects that other programs wrote. Pure. Any thread.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace fxagent {

/// nlohmann::json or ordered_json.
template <class Json>
concept JsonValue = nlohmann::detail::is_basic_json<Json>::value;

/// Returns a member of an object; null if there is none, or `object` is none.
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
