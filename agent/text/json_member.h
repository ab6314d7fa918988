// Members of JSON objects that other programs wrote. Pure. Any thread.
#pragma once

#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

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

/// Returns the JSON in one line. Bytes that are not UTF-8 become U+FFFD.
template <JsonValue Json>
std::string dumped(const Json& json) {
  return json.dump(-1, ' ', /*ensure_ascii=*/false, Json::error_handler_t::replace);
}

/// Returns a boolean, a number or a text; nullopt for null, an array or an object.
inline std::optional<Scalar> scalar_of(const nlohmann::json& json) {
  if (json.is_boolean()) return Scalar(json.get<bool>());
  if (json.is_number_unsigned() &&
      json.get<std::uint64_t>() > std::uint64_t{std::numeric_limits<std::int64_t>::max()})
    return Scalar(BigInteger{json.dump()});
  if (json.is_number_integer()) return Scalar(json.get<std::int64_t>());
  if (json.is_number_float()) return Scalar(json.get<double>());
  if (json.is_string()) return Scalar(json.get<std::string>());
  return std::nullopt;
}

}  // namespace fxagent
