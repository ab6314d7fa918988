#include "protocol/value/exact_number.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <compare>
#include <limits>
#include <string>
#include <utility>

namespace fxagent {
namespace {

/// digits × 10^exponent
struct Decimal {
  Whole digits;
  int exponent = 0;
};

Whole power_of_ten(int exponent) {
  return boost::multiprecision::pow(Whole(10), static_cast<unsigned>(exponent));
}

/// Writes the shortest decimal spelling of a finite number to `text`. Returns its digits, with a
/// minus if it is negative and perhaps a point, and the exponent that they have without the point.
std::pair<std::string_view, int> spelling_of(double number, std::array<char, 64>& text) {
  const auto end =
      std::to_chars(text.data(), text.data() + text.size(), number, std::chars_format::scientific)
          .ptr;
  const std::string_view spelling(text.data(), static_cast<std::size_t>(end - text.data()));
  const auto e = spelling.find('e');
  const std::string_view digits = spelling.substr(0, e);
  int exponent = 0;
  std::from_chars(spelling.data() + e + (spelling[e + 1] == '+' ? 2 : 1), end, exponent);
  if (const auto point = digits.find('.'); point != digits.npos)
    exponent -= static_cast<int>(digits.size() - point - 1);
  return {digits, exponent};
}

Decimal decimal_of(double number) {
  std::array<char, 64> text{};
  const auto [spelled, exponent] = spelling_of(number, text);
  std::string digits(spelled);
  std::erase(digits, '.');
  const bool is_negative = digits.front() == '-';
  const Whole magnitude(is_negative ? digits.substr(1) : digits);
  return {is_negative ? Whole(-magnitude) : magnitude, exponent};
}

Decimal decimal_of(const Scalar& scalar) {
  if (const auto* real = std::get_if<double>(&scalar)) return decimal_of(*real);
  if (const auto* large = std::get_if<BigInteger>(&scalar)) return {Whole(large->digits), 0};
  if (const auto* whole = std::get_if<std::int64_t>(&scalar)) return {Whole(*whole), 0};
  return {Whole(std::get<bool>(scalar) ? 1 : 0), 0};
}

/// Returns `number` as a multiple of 10^exponent. `exponent` must not exceed the exponent of
/// `number`.
Whole at_exponent(const Decimal& number, int exponent) {
  return number.digits * power_of_ten(number.exponent - exponent);
}

/// Divides and rounds to the nearest integer, ties away from zero.
Whole divided(const Whole& number, const Whole& by) {
  const bool is_negative = (number < 0) != (by < 0);
  const Whole magnitude = boost::multiprecision::abs(number);
  const Whole divisor = boost::multiprecision::abs(by);
  const Whole nearest = (2 * magnitude + divisor) / (2 * divisor);
  return is_negative ? Whole(-nearest) : nearest;
}

}  // namespace

int decimals_of(double number) {
  std::array<char, 64> text{};
  return std::max(0, -spelling_of(number, text).second);
}

std::optional<Whole> whole_from(std::string_view text) {
  constexpr std::size_t kMostDigits = 40;
  const bool is_negative = text.starts_with('-');
  const std::string_view digits = text.substr(is_negative ? 1 : 0);
  const bool good = !digits.empty() && digits.size() <= kMostDigits &&
                    digits.find_first_not_of("0123456789") == digits.npos &&
                    (digits.front() != '0' || text == "0");
  if (!good) return std::nullopt;
  const Whole number{std::string(digits)};
  return is_negative ? Whole(-number) : number;
}

Scalar scalar_of(const Whole& number) {
  using Int64 = std::numeric_limits<std::int64_t>;
  if (number >= Int64::min() && number <= Int64::max())
    return Scalar(number.convert_to<std::int64_t>());
  return Scalar(BigInteger{number.str()});
}

Scalar scaled_exactly(const Whole& raw, double scale, double offset) {
  const Decimal factor = decimal_of(scale);
  const Decimal added = decimal_of(offset);
  const int exponent = std::min({factor.exponent, added.exponent, 0});
  const Whole sum = raw * at_exponent(factor, exponent) + at_exponent(added, exponent);
  const Whole one = power_of_ten(-exponent);
  if (boost::multiprecision::abs(sum) > one * Whole(std::int64_t{1} << 53))
    return scalar_of(divided(sum, one));
  const std::string text = sum.str() + "e" + std::to_string(exponent);
  double value = 0;
  std::from_chars(text.data(), text.data() + text.size(), value);
  return Scalar(value);
}

Whole unscaled_exactly(const Scalar& value, double scale, double offset) {
  const Decimal number = decimal_of(value);
  const Decimal factor = decimal_of(scale);
  const Decimal added = decimal_of(offset);
  const int exponent = std::min({number.exponent, factor.exponent, added.exponent});
  return divided(at_exponent(number, exponent) - at_exponent(added, exponent),
                 at_exponent(factor, exponent));
}

std::strong_ordering compare_exactly(const Scalar& one, const Scalar& other) {
  const Decimal left = decimal_of(one);
  const Decimal right = decimal_of(other);
  const int exponent = std::min(left.exponent, right.exponent);
  const int sign = at_exponent(left, exponent).compare(at_exponent(right, exponent));
  return sign <=> 0;
}

}  // namespace fxagent
