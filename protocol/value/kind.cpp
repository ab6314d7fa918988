#include "protocol/value/kind.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <system_error>

#include "protocol/value/raw.h"

namespace fxagent {
namespace {

/// Returns a quoted text if it is short and printable ASCII, otherwise an empty one.
std::string shown(const std::string& text) {
  constexpr std::size_t kMost = 32;
  const bool plain = text.size() <= kMost && std::ranges::all_of(text, [](char c) {
                       return c >= ' ' && c <= '~' && c != '"' && c != '\\';
                     });
  return plain ? '"' + text + '"' : std::string();
}

/// Returns the number that a text spells; ignores blanks around it.
std::optional<double> number_in(const std::string& text) {
  const std::size_t first = text.find_first_not_of(' ');
  if (first == text.npos) return std::nullopt;
  const char* const end = text.data() + text.find_last_not_of(' ') + 1;
  double number = 0;
  const auto [stop, fault] = std::from_chars(text.data() + first, end, number);
  const bool is_whole = fault == std::errc() && stop == end;
  return is_whole && std::isfinite(number) ? std::optional(number) : std::nullopt;
}

/// Returns the end of a sentence that names what `type` takes: `: send the number 50, not the text
/// "50"`. Quotes a text only if it is short and printable. Empty if there is nothing to add. Forms
/// and flows often turn numbers into text.
std::string instead_of(const Scalar& scalar, DataType type) {
  if (const auto* text = std::get_if<std::string>(&scalar)) {
    const bool is_bit = type == DataType::boolean;
    if (is_bit && (*text == "true" || *text == "false"))
      return ": send " + *text + " without quotes, not the text " + shown(*text);
    if (const auto number = number_in(*text); number && !shown(*text).empty())
      return ": send the number " + spelled(*number) + ", not the text " + shown(*text);
    return shown(*text).empty() ? ", not a text" : ", not the text " + shown(*text);
  }
  if (type == DataType::string) {
    const auto* flag = std::get_if<bool>(&scalar);
    if (flag != nullptr) return ": send it in quotes";
    return ": send \"" + spelled(scalar) + "\" in quotes, not a number";
  }
  if (const auto* flag = std::get_if<bool>(&scalar); flag != nullptr && type != DataType::boolean)
    return std::string(": send ") + (*flag ? "1, not true" : "0, not false");
  return {};
}

/// Checks that the scalar is of a kind that the point's type takes.
Result<void> check_scalar(const Point& point, const Scalar& given) {
  const Scalar scalar = without_quotes(point, given);
  const auto* whole = std::get_if<std::int64_t>(&scalar);
  const auto* real = std::get_if<double>(&scalar);
  if (real != nullptr && !std::isfinite(*real)) return refuse("the value is not finite");
  const std::string type(to_string(point.type));
  if (point.type == DataType::boolean) {
    const bool bit = std::holds_alternative<bool>(scalar) ||
                     (whole != nullptr && (*whole == 0 || *whole == 1)) ||
                     (real != nullptr && (*real == 0.0 || *real == 1.0));
    if (!bit) return refuse(type + " takes true, false, 1 or 0" + instead_of(scalar, point.type));
  } else if (point.type == DataType::string) {
    if (!std::holds_alternative<std::string>(scalar))
      return refuse(type + " takes a text" + instead_of(scalar, point.type));
  } else if (!number_of(scalar)) {
    return refuse(type + " takes a number" + instead_of(scalar, point.type));
  }
  return {};
}

}  // namespace

Scalar without_quotes(const Point& point, const Scalar& scalar) {
  const auto* text = std::get_if<std::string>(&scalar);
  if (text == nullptr || is_float(point.type) || bits_of_type(point.type) < 16) return scalar;
  const auto whole = whole_from(*text);
  const bool is_wide = bits_of_type(point.type) == 64;
  const bool is_large = whole && abs(*whole) > Whole(kExactDouble);
  if (!whole || !(is_wide || (point.scaled() && is_large))) return scalar;
  return scalar_of(*whole);
}

Result<void> check_kind(const Point& point, const Value& value) {
  if (value.is_array != point.is_array)
    return refuse(point.is_array ? "an array is expected" : "one value is expected, not an array");
  if (value.items.size() != point.count)
    return refuse(std::to_string(value.items.size()) + " elements given, " +
                  std::to_string(point.count) + " expected");
  for (const Scalar& scalar : value.items)
    if (auto kind = check_scalar(point, scalar); !kind) return kind;
  return {};
}

}  // namespace fxagent
