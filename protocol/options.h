// Settings of a device that belong to its protocol.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace fxagent {

using OptionValue = std::variant<std::int64_t, bool, std::string>;

/// One config key of a device that belongs to its protocol.
struct OptionSpec {
  enum class Kind : std::uint8_t { integer, boolean, choice };
  std::string_view key;
  Kind kind = Kind::integer;
  std::int64_t min = 0;  ///< integer: inclusive bounds
  std::int64_t max = 0;
  std::vector<std::string_view> choices;  ///< choice: the words
  OptionValue fallback;                   ///< used if the key is absent
  std::string_view meaning;               ///< human-readable; the schema and the README quote it
  /// integer: from this value on frames are binary, and a serial line needs 8 data bits.
  std::optional<std::int64_t> binary_from{};
};

/// Value of `model` if the agent is to ask the device for it.
inline constexpr std::string_view kAutoModel = "auto";
/// Every option of the protocol, configured or default. `model` is always present, also as "auto".
using Options = std::map<std::string, OptionValue, std::less<>>;

/// Returns "12", "true" or the word.
inline std::string to_string(const OptionValue& value) {
  if (const auto* number = std::get_if<std::int64_t>(&value)) return std::to_string(*number);
  if (const auto* flag = std::get_if<bool>(&value)) return *flag ? "true" : "false";
  return std::get<std::string>(value);
}

/// Returns the value of an option, or null if it is absent or has another type.
template <class T>
const T* option(const Options& options, std::string_view key) {
  const auto found = options.find(key);
  return found == options.end() ? nullptr : std::get_if<T>(&found->second);
}

/// Sets `value` to an integer option if that is given. Then clamps it to `least` … `most`, which
/// its type must hold.
template <class Number>
void take_option(Number& value, const Options& options, std::string_view key, std::int64_t least,
                 std::int64_t most) {
  const auto* given = option<std::int64_t>(options, key);
  value = static_cast<Number>(std::clamp(given ? *given : std::int64_t{value}, least, most));
}
/// Replaces `value` by a boolean option if that is given.
inline void take_option(bool& value, const Options& options, std::string_view key) {
  if (const auto* given = option<bool>(options, key)) value = *given;
}

}  // namespace fxagent
