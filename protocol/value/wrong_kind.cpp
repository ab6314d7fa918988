#include "protocol/value/wrong_kind.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <system_error>
#include <variant>

#include "protocol/value/value_range.h"

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

}  // namespace

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

}  // namespace fxagent
