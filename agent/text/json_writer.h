// Writes JSON text piece by piece. The output is valid JSON for any input: no NaN, no Inf, and
// U+FFFD in place of bytes that are not UTF-8. Integers beyond ±2^53 become strings, because a
// reader that uses doubles would change them. Any thread.
#pragma once

#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "agent/text/text.h"
#include "protocol/value/value.h"

namespace fxagent::json {

/// Largest magnitude up to which a double holds every integer exactly.
inline constexpr std::int64_t kMaxExactInteger = std::int64_t{1} << 53;

class Writer final {
 public:
  Writer() = default;
  /// Reserves `expected` bytes for the text.
  explicit Writer(std::size_t expected) { text_.reserve(expected); }

  Writer& begin_object() { return open('{'); }
  Writer& end_object() { return close('}'); }
  Writer& begin_array() { return open('['); }
  Writer& end_array() { return close(']'); }

  Writer& key(std::string_view name) {
    separate();
    append_json_string(text_, name);
    text_ += ':';
    comma_ = false;
    return *this;
  }
  Writer& string(std::string_view value) {
    separate();
    append_json_string(text_, value);
    return *this;
  }
  /// Writes null if `value` is empty.
  Writer& word(std::string_view value) { return value.empty() ? null() : string(value); }
  Writer& boolean(bool value) { return raw(value ? "true" : "false"); }
  Writer& null() { return raw("null"); }
  Writer& raw(std::string_view json) {
    separate();
    text_ += json;
    return *this;
  }
  Writer& integer(std::int64_t value) {
    return digits(value, value > kMaxExactInteger || value < -kMaxExactInteger);
  }
  Writer& integer(std::uint64_t value) {
    return digits(value, value > static_cast<std::uint64_t>(kMaxExactInteger));
  }
  /// Writes the shortest text that reads back as the same number, or null if it is not finite.
  template <class Float>
  Writer& number(Float value) {
    return std::isfinite(value) ? digits(value, false) : null();
  }
  /// Writes a duration in ms with at most three decimals.
  Writer& milliseconds(std::chrono::nanoseconds duration) {
    return number(std::round(static_cast<double>(duration.count()) / 1e3) / 1e3);
  }

  // Each of these writes null if there is no value.
  Writer& boolean(std::optional<bool> value) { return value ? boolean(*value) : null(); }
  Writer& integer(std::optional<std::int64_t> value) { return value ? integer(*value) : null(); }
  Writer& number(std::optional<double> value) { return value ? number(*value) : null(); }
  Writer& milliseconds(std::optional<std::chrono::nanoseconds> duration) {
    return duration ? milliseconds(*duration) : null();
  }

  std::string take() { return std::move(text_); }

 private:
  Writer& open(char bracket) {
    separate();
    text_ += bracket;
    comma_ = false;
    return *this;
  }
  Writer& close(char bracket) {
    text_ += bracket;
    comma_ = true;
    return *this;
  }
  void separate() {
    if (comma_) text_ += ',';
    comma_ = true;
  }
  template <class Number>
  Writer& digits(Number value, bool quoted) {
    std::array<char, 40> room{};
    const char* const end = std::to_chars(room.data(), room.data() + room.size(), value).ptr;
    const std::string_view text(room.data(), static_cast<std::size_t>(end - room.data()));
    return quoted ? string(text) : raw(text);
  }

  std::string text_;
  bool comma_ = false;
};

/// Number of digits of a real number. `single` writes a float32 as short as a float allows (5.1,
/// not 5.099999904632568).
enum class Precision : std::uint8_t { full, single };

/// Writes null if `value` is empty.
void write_value(Writer& out, const Value& value, Precision precision = Precision::full);
/// Writes null if `value` is nullopt.
void write_optional(Writer& out, const std::optional<Value>& value);

/// True if a text accepted by a JSON parser can be embedded unchanged in another one: it contains
/// nothing that the parser skips (a byte order mark) or treats as the end (a NUL).
bool may_stand_inside(std::string_view json);

}  // namespace fxagent::json
