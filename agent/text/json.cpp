#include "agent/text/json.h"

#include <charconv>
#include <cmath>
#include <cstdint>
#include <limits>

#include "agent/text/json_writer.h"

namespace fxagent {
namespace {

template <JsonValue Json>
std::string text_of(const Json& json, bool in_ascii) {
  return json.dump(-1, ' ', in_ascii, Json::error_handler_t::replace);
}

}  // namespace

nlohmann::ordered_json json_number(double value) {
  constexpr auto kExact = static_cast<double>(json::kMaxExactInteger);
  if (value != std::trunc(value) || std::abs(value) > kExact) return value;
  return static_cast<std::int64_t>(value);
}

nlohmann::json parsed_json(std::string_view text, bool ignore_comments) {
  return nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false, ignore_comments);
}

nlohmann::ordered_json parsed_ordered_json(std::string_view text) {
  return nlohmann::ordered_json::parse(text, nullptr, /*allow_exceptions=*/false);
}

std::string_view vanishing_number(std::string_view json) {
  bool in_string = false;
  for (std::size_t i = 0; i < json.size(); ++i) {
    if (json[i] == '"') in_string = !in_string;
    if (in_string && json[i] == '\\') ++i;
    if (in_string || (json[i] != '-' && (json[i] < '0' || json[i] > '9'))) continue;
    const auto number = json.substr(i, json.find_first_not_of("0123456789.eE+-", i) - i);
    double value = 0;
    std::from_chars(number.data(), number.data() + number.size(), value);
    const auto digits = number.substr(0, number.find_first_of("eE"));
    if (value == 0 && digits.find_first_of("123456789") != digits.npos) return number;
    i += number.size() - 1;
  }
  return {};
}

std::string dumped(const nlohmann::json& json) { return text_of(json, false); }
std::string dumped(const nlohmann::ordered_json& json) { return text_of(json, false); }
std::string dumped_in_ascii(const nlohmann::ordered_json& json) { return text_of(json, true); }

std::optional<Scalar> scalar_of(const nlohmann::json& json) {
  if (json.is_boolean()) return Scalar(json.get<bool>());
  if (json.is_number_unsigned() &&
      json.get<std::uint64_t>() > std::uint64_t{std::numeric_limits<std::int64_t>::max()})
    return Scalar(BigInteger{dumped(json)});
  if (json.is_number_integer()) return Scalar(json.get<std::int64_t>());
  if (json.is_number_float()) return Scalar(json.get<double>());
  if (json.is_string()) return Scalar(json.get<std::string>());
  return std::nullopt;
}

}  // namespace fxagent
