#include "protocol/value/value.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "protocol/value/exact_number.h"

namespace fxagent {

bool shows(const Value& shown, const Value& wanted) {
  const auto same = [](const Scalar& is, const Scalar& should) {
    if (std::holds_alternative<std::string>(is)) return is == should;
    const auto* text = std::get_if<std::string>(&should);
    const auto whole = text != nullptr ? whole_from(*text) : std::nullopt;
    return compare(is, whole ? scalar_of(*whole) : should) == std::partial_ordering::equivalent;
  };
  return shown.is_array == wanted.is_array && std::ranges::equal(shown.items, wanted.items, same);
}

std::optional<double> number_of(const Scalar& scalar) {
  if (const auto* whole = std::get_if<std::int64_t>(&scalar)) return static_cast<double>(*whole);
  if (const auto* real = std::get_if<double>(&scalar)) return *real;
  if (const auto* large = std::get_if<BigInteger>(&scalar))
    return Whole(large->digits).convert_to<double>();
  return std::nullopt;
}

double as_double(const Scalar& scalar) {
  if (const auto* flag = std::get_if<bool>(&scalar)) return *flag ? 1 : 0;
  return number_of(scalar).value_or(0);
}

std::optional<std::partial_ordering> compare(const Scalar& one, const Scalar& other) {
  if (std::holds_alternative<std::string>(one) || std::holds_alternative<std::string>(other))
    return std::nullopt;
  const double a = as_double(one);
  const double b = as_double(other);
  // Rounding keeps the order of numbers, so only numbers with equal doubles need an exact
  // comparison.
  if (a != b || std::abs(a) < kExactDouble || !std::isfinite(a)) return a <=> b;
  return compare_exactly(one, other);
}

std::string spelled(double number) {
  std::array<char, 32> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), number).ptr;
  return {text.data(), end};
}

std::string spelled(const Scalar& scalar) {
  if (const auto* text = std::get_if<std::string>(&scalar)) return *text;
  if (const auto* large = std::get_if<BigInteger>(&scalar)) return large->digits;
  if (const auto* whole = std::get_if<std::int64_t>(&scalar)) return std::to_string(*whole);
  return spelled(as_double(scalar));
}

}  // namespace fxagent
