// Writes JSON text, piece by piece. What goes out is valid JSON whatever comes in: no NaN, no Inf,
// and text that is not UTF-8 gets U+FFFD. Integers beyond ±2^53 become strings, since a reader's
// double would change them. Any thread.
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

#include "protocol/point.h"

namespace fxagent::json {

/// Up to here, and down to its negative, a double holds every integer.
inline constexpr std::int64_t kMaxExactInteger = std::int64_t{1} << 53;

class Writer final {
 public:
  Writer() = default;
  /// For a text of about so many bytes.
  explicit Writer(std::size_t expected) { text_.reserve(expected); }

  Writer& begin_object() { return open('{'); }
  Writer& end_object() { return close('}'); }
  Writer& begin_array() { return open('['); }
  Writer& end_array() { return close(']'); }

  Writer& key(std::string_view name) {
    separate();
    append_text(name);
    text_ += ':';
    comma_ = false;
    return *this;
  }
  Writer& string(std::string_view value) {
    separate();
    append_text(value);
    return *this;
  }
  /// Null where it is empty.
  Writer& word(std::string_view value) { return value.empty() ? null() : string(value); }
  Writer& boolean(bool value) { return raw(value ? "true" : "false"); }
  Writer& null() { return raw("null"); }
  Writer& raw(std::string_view json) {
    separate();
    text_ += json;
    return *this;
  }
  Writer& integer(std::int64_t value) {
    return integer_text(value, value > kMaxExactInteger || value < -kMaxExactInteger);
  }
  Writer& integer(std::uint64_t value) {
    return integer_text(value, value > static_cast<std::uint64_t>(kMaxExactInteger));
  }
  /// The shortest text that reads back as the same number; null where it is none.
  template <class Float>
  Writer& number(Float value) {
    if (!std::isfinite(value)) return null();
    std::array<char, 40> digits{};
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
    return raw(std::string_view(digits.data(), static_cast<std::size_t>(end - digits.data())));
  }
  /// A duration as ms with at most three decimals.
  Writer& milliseconds(std::chrono::nanoseconds duration) {
    return number(std::round(static_cast<double>(duration.count()) / 1e3) / 1e3);
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
  template <class Integer>
  Writer& integer_text(Integer value, bool quoted) {
    std::array<char, 24> digits{};
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
    const std::string_view text(digits.data(), static_cast<std::size_t>(end - digits.data()));
    return quoted ? string(text) : raw(text);
  }
  void append_text(std::string_view value);

  std::string text_;
  bool comma_ = false;
};

/// How many digits a real number gets: a float32 is written as short as a float can be (5.1, not
/// 5.099999904632568).
enum class Precision : std::uint8_t { full, single };

/// Null where the value is empty.
void write_value(Writer& out, const Value& value, Precision precision = Precision::full);
/// Null where there is none.
void write_optional(Writer& out, const std::optional<Value>& value);

/// Whether a text that a parser takes for JSON may be put into another one as it is: it has nothing
/// that the parser passes over (a byte order mark) or takes for the end (a NUL).
bool may_stand_inside(std::string_view json);

}  // namespace fxagent::json
