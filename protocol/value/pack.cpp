#include "protocol/value/pack.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <optional>
#include <string_view>
#include <system_error>
#include <utility>

#include "protocol/value/raw.h"

namespace fxagent {

// ---- kinds -------------------------------------------------------------------------------------

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

/// Returns the integer that a text spells; ignores blanks around it and zeros before it.
std::optional<Whole> whole_in(std::string text) {
  text.erase(text.find_last_not_of(' ') + 1);
  text.erase(0, text.find_first_not_of(' '));
  const std::size_t sign = text.starts_with('-') ? 1 : 0;
  while (text.size() > sign + 1 && text[sign] == '0') text.erase(sign, 1);
  return whole_from(text);
}

/// Returns the end of a sentence that names what `type` takes: `: send the number 50, not the text
/// "50"`. Quotes a text only if it is short and printable. Empty if there is nothing to add. Forms
/// and flows often turn numbers into text.
std::string instead_of(const Scalar& scalar, DataType type) {
  if (const auto* text = std::get_if<std::string>(&scalar)) {
    const bool is_bit = type == DataType::boolean;
    if (is_bit && (*text == "true" || *text == "false"))
      return ": send " + *text + " without quotes, not the text " + shown(*text);
    const auto whole = whole_in(*text);
    if (whole && !shown(*text).empty() && !is_float(type) && bits_of_type(type) == 64)
      return ", or a text without leading zeros or spaces: \"" + whole->str() + "\", not " +
             shown(*text);
    if (const auto number = number_in(*text); number && !shown(*text).empty())
      return ": send the number " + (whole ? whole->str() : spelled(*number)) + ", not the text " +
             shown(*text);
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

/// Returns the integer in a text if samples of the point may have one in that form, otherwise the
/// scalar itself.
Scalar without_quotes(const Point& point, const Scalar& scalar) {
  const auto* text = std::get_if<std::string>(&scalar);
  if (text == nullptr || is_float(point.type) || bits_of_type(point.type) < 16) return scalar;
  const auto whole = whole_from(*text);
  const bool is_wide = bits_of_type(point.type) == 64;
  const bool is_large = whole && abs(*whole) > Whole(kExactDouble);
  if (!whole || !(is_wide || (point.scaled() && is_large))) return scalar;
  return scalar_of(*whole);
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

/// Returns the beginning of an error text about item `i`; empty if the value is no array.
std::string place_in(const Value& value, std::size_t i) {
  return value.is_array ? "element " + std::to_string(i + 1) + ": " : std::string();
}

}  // namespace

Result<void> check_kind(const Point& point, const Value& value) {
  if (value.is_array && value.items.empty()) return refuse("an array without elements");
  if (value.is_array != point.is_array)
    return refuse(point.is_array ? "an array is expected" : "one value is expected, not an array");
  if (value.items.size() != point.count)
    return refuse(std::to_string(value.items.size()) + " elements given, " +
                  std::to_string(point.count) + " expected");
  for (std::size_t i = 0; i < value.items.size(); ++i)
    if (const auto kind = check_scalar(point, value.items[i]); !kind)
      return refuse(place_in(value, i) + kind.error().text);
  return {};
}

// ---- from values to images ---------------------------------------------------------------------

namespace {

void set_bits(Bytes& image, std::size_t to_bit, std::uint32_t bits, std::uint64_t value) {
  for (std::uint32_t i = 0; i < bits; ++i)
    if (value >> i & 1)
      image[(to_bit + i) / 8] |= static_cast<std::uint8_t>(1U << ((to_bit + i) % 8));
}

/// Returns nullopt if the text is not UTF-8, or contains NUL or a character that Latin-1 lacks.
std::optional<Bytes> latin1_from_utf8(std::string_view text) {
  Bytes bytes;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto lead = static_cast<std::uint8_t>(text[i]);
    if (lead != 0 && lead < 0x80) {
      bytes.push_back(lead);
      continue;
    }
    // C2 and C3 begin the characters 80h to FFh.
    const auto next = i + 1 < text.size() ? static_cast<std::uint8_t>(text[i + 1]) : 0;
    if ((lead != 0xC2 && lead != 0xC3) || (next & 0xC0) != 0x80) return std::nullopt;
    bytes.push_back(static_cast<std::uint8_t>((lead & 3) << 6 | (next & 0x3F)));
    ++i;
  }
  return bytes;
}

tl::unexpected<PackError> bad_value(std::string text) {
  return tl::unexpected<PackError>(PackError{PackFault::bad_value, std::move(text)});
}
tl::unexpected<PackError> out_of_range(std::string text) {
  return tl::unexpected<PackError>(PackError{PackFault::out_of_range, std::move(text)});
}

using Packed = tl::expected<void, PackError>;

/// Checks that the device can store the characters, if the scalar is a text.
Packed check_characters(const Scalar& scalar) {
  const auto* text = std::get_if<std::string>(&scalar);
  if (text != nullptr && !latin1_from_utf8(*text))
    return bad_value("the text has a character that is not Latin-1, or NUL");
  return {};
}

template <class Float, class Pattern>
Packed pack_float(const Point& point, const Scalar& scalar, Bytes& image, std::size_t bit) {
  const double value = as_double(scalar);
  const double unshifted = point.scaled() ? value - point.offset : value;
  const auto number = static_cast<Float>(point.scaled() ? unshifted / point.scale : unshifted);
  if (!std::isfinite(number) || (number == 0 && unshifted != 0))
    return out_of_range(spelled(value) + " does not fit a " + std::string(to_string(point.type)));
  const auto pattern = std::bit_cast<Pattern>(number);
  set_bits(image, bit, 8 * sizeof pattern, reordered(pattern, 8 * sizeof pattern, point.order));
  return {};
}

Packed pack_integer(const Point& point, const Scalar& scalar, Bytes& image, std::size_t bit,
                    std::uint32_t bits) {
  const Limits limits = limits_of(point.type, bits);
  const Whole nearest = nearest_raw(point, scalar);
  if (nearest < limits.min || nearest > limits.max)
    return out_of_range(spelled(scalar) + " is raw " + nearest.str() + "; " +
                        std::string(to_string(point.type)) + " holds " +
                        std::to_string(limits.min) + " to " + std::to_string(limits.max));
  const auto* real = std::get_if<double>(&scalar);
  if (real != nullptr && !point.scaled() && std::abs(*real) >= kExactDouble)
    return bad_value(
        "a number with a decimal point is not exact from 2^53 on: send the integer "
        "without a point");
  std::uint64_t raw = nearest < 0 ? ~Whole(-nearest - 1).convert_to<std::uint64_t>()
                                  : nearest.convert_to<std::uint64_t>();
  if (is_bcd(point.type)) raw = to_bcd(static_cast<std::int64_t>(raw));
  if (point.address.unit == Unit::word) raw = reordered(raw, bits, point.order);
  set_bits(image, bit, bits, raw);
  return {};
}

Packed pack_text(const Point& point, const Scalar& scalar, Bytes& image, std::size_t bit) {
  const auto characters = latin1_from_utf8(std::get<std::string>(scalar));
  if (characters->size() > point.length)
    return out_of_range("the text has " + std::to_string(characters->size()) +
                        " characters, but there is room for " + std::to_string(point.length));
  for (std::size_t i = 0; i < characters->size(); ++i)
    image[bit / 8 + character_at(i, point.order)] = (*characters)[i];
  return {};
}

Packed pack_element(const Point& point, const Scalar& given, Bytes& image, std::size_t bit,
                    std::uint32_t bits) {
  const Scalar scalar = without_quotes(point, given);
  switch (point.type) {
    case DataType::boolean: {
      const auto* flag = std::get_if<bool>(&scalar);
      set_bits(image, bit, 1, (flag != nullptr ? *flag : as_double(scalar) != 0.0) ? 1 : 0);
      return {};
    }
    case DataType::string:
      return pack_text(point, scalar, image, bit);
    case DataType::float32:
      return pack_float<float, std::uint32_t>(point, scalar, image, bit);
    case DataType::float64:
      return pack_float<double, std::uint64_t>(point, scalar, image, bit);
    default:
      return pack_integer(point, scalar, image, bit, bits);
  }
}

}  // namespace

tl::expected<Bytes, PackError> pack(const Point& point, const Value& value) {
  const auto span = span_of(point);
  if (!span) return bad_value(span.error().text);
  if (auto kind = check_kind(point, value); !kind) return bad_value(std::move(kind.error().text));
  for (std::size_t i = 0; i < value.items.size(); ++i)
    if (const auto characters = check_characters(value.items[i]); !characters)
      return bad_value(place_in(value, i) + characters.error().text);
  Bytes image((span->bits + 7) / 8, 0);
  const std::uint32_t bits = span->bits / point.count;
  for (std::size_t i = 0; i < value.items.size(); ++i)
    if (auto packed = pack_element(point, value.items[i], image, i * bits, bits); !packed)
      return tl::unexpected<PackError>(
          PackError{packed.error().fault, place_in(value, i) + packed.error().text});
  return image;
}

bool has_padding(const Point& point) {
  return point.type == DataType::string && point.length % 2 != 0;
}

Bytes with_padding_of(const Point& point, Bytes image, ByteView other) {
  if (!has_padding(point)) return image;
  const std::size_t bytes = point.length + std::size_t{1};
  // The last character is the low byte of its word, or with `abcd` the high one.
  const std::size_t at = point.order == ByteOrder::abcd ? bytes - 2 : bytes - 1;
  for (std::size_t i = at; i < image.size() && i < other.size(); i += bytes) image[i] = other[i];
  return image;
}

// ---- from images to values ---------------------------------------------------------------------

namespace {

double widen(double number) { return number; }
/// Returns the double with the same shortest spelling as `number`: 23.4 for 23.4F, not
/// 23.399999618530273.
double widen(float number) {
  std::array<char, 32> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), number).ptr;
  double wide = 0;
  std::from_chars(text.data(), end, wide);
  return wide;
}

// A character of a PLC has eight bits, which are read as Latin-1. JSON needs UTF-8.
std::string utf8_from_latin1(std::uint8_t byte) {
  if (byte < 0x80) return std::string(1, static_cast<char>(byte));
  return {static_cast<char>(0xC0 | byte >> 6), static_cast<char>(0x80 | (byte & 0x3F))};
}

/// Decodes a float from its bit pattern `raw`.
template <class Float, class Pattern>
Result<Scalar> float_from(const Point& point, Pattern raw) {
  const auto number = std::bit_cast<Float>(raw);
  if (!std::isfinite(number))
    return refuse(hex_text(raw, static_cast<int>(2 * sizeof raw)) +
                  (std::isnan(number) ? " is NaN" : " is infinite"));
  return scaled_real(point, widen(number));
}

Result<Scalar> element_from(const Point& point, ByteView image, std::size_t bit,
                            std::uint32_t bits) {
  if (point.type == DataType::boolean) return Scalar(bits_at(image, bit, 1) != 0);
  if (point.type == DataType::string) {
    std::string text;
    for (std::size_t i = 0; i < point.length; ++i) {
      const std::size_t at = bit / 8 + character_at(i, point.order);
      const auto byte = static_cast<std::uint8_t>(bits_at(image, 8 * at, 8));
      if (byte == 0) break;
      text += utf8_from_latin1(byte);
    }
    return Scalar(std::move(text));
  }
  std::uint64_t raw = bits_at(image, bit, bits);
  if (point.address.unit == Unit::word) raw = reordered(raw, bits, point.order);
  if (point.type == DataType::float64) return float_from<double>(point, raw);
  if (point.type == DataType::float32)
    return float_from<float>(point, static_cast<std::uint32_t>(raw));
  if (is_bcd(point.type)) {
    const auto number = from_bcd(static_cast<std::uint32_t>(raw));
    if (!number) return refuse(hex_text(raw, static_cast<int>(bits / 4)) + " is not BCD");
    return scaled_whole(point, *number);
  }
  Whole number(raw);
  if (raw > limits_of(point.type, bits).max) number -= Whole(1) << bits;
  return scaled_whole(point, number);
}

}  // namespace

Result<Value> unpack(const Point& point, ByteView image, std::uint32_t image_first_bit) {
  const auto span = span_of(point);
  if (!span) return fail(span);
  const std::uint64_t image_end = image_first_bit + std::uint64_t{image.size()} * 8;
  if (span->first_bit < image_first_bit || span->end_bit() > image_end)
    return fail(ErrorCode::unsupported, point.address.text + " is not in what was read");
  const std::uint32_t bits = span->bits / point.count;
  std::size_t bit = span->first_bit - image_first_bit;
  Value value;
  value.is_array = point.is_array;
  value.items.reserve(point.count);
  for (std::uint16_t i = 0; i < point.count; ++i, bit += bits) {
    auto element = element_from(point, image, bit, bits);
    if (!element) return tl::make_unexpected(std::move(element.error()));
    value.items.push_back(std::move(*element));
  }
  return value;
}

}  // namespace fxagent
