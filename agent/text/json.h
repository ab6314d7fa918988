// Reads and writes JSON with nlohmann's library. Its parser and its printer are compiled in
// json.cpp for all: each takes a second more in a file that calls it directly, as those do that
// need a callback or indentation. Pure. Any thread.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "protocol/value/value.h"

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

/// Returns the value, or null if it is absent. An empty string counts as absent.
template <class Value>
nlohmann::ordered_json or_null(const std::optional<Value>& value) {
  return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json();
}
inline nlohmann::ordered_json or_null(const std::string& text) {
  return text.empty() ? nlohmann::ordered_json() : nlohmann::ordered_json(text);
}

/// Returns a number, as an integer if it is whole and at most 2^53 in size. One that is not finite
/// is printed as null.
nlohmann::ordered_json json_number(double value);

/// Parses a document. Returns a discarded value if the text is not JSON.
nlohmann::json parsed_json(std::string_view text, bool ignore_comments = false);
nlohmann::ordered_json parsed_ordered_json(std::string_view text);

/// Returns the first number of a JSON text that is read as 0 although it is not 0: 1e-400 is too
/// close to 0 for a double. Empty: none.
std::string_view vanishing_number(std::string_view json);

/// Returns the JSON in one line. Bytes that are not UTF-8 become U+FFFD.
std::string dumped(const nlohmann::json& json);
std::string dumped(const nlohmann::ordered_json& json);
/// Same, with every character that is not ASCII escaped.
std::string dumped_in_ascii(const nlohmann::ordered_json& json);

/// Returns a boolean, a number or a text; nullopt for null, an array or an object.
std::optional<Scalar> scalar_of(const nlohmann::json& json);

}  // namespace fxagent
