#include "protocol/point.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>

#include "protocol/exact_number.h"
#include "protocol/value_range.h"
#include "protocol/wrong_kind.h"

namespace fxagent {
namespace {

struct Word {
  std::string_view text;
  DataType type;
};
constexpr std::array<Word, 12> kTypes = {{
    {"bool", DataType::boolean},
    {"int16", DataType::int16},
    {"uint16", DataType::uint16},
    {"int32", DataType::int32},
    {"uint32", DataType::uint32},
    {"float32", DataType::float32},
    {"bcd16", DataType::bcd16},
    {"bcd32", DataType::bcd32},
    {"string", DataType::string},
    {"int64", DataType::int64},
    {"uint64", DataType::uint64},
    {"float64", DataType::float64},
}};

// More decimals than a double can show.
constexpr int kMaxDecimals = 17;

constexpr std::array<double, kMaxDecimals + 1> kPowers = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,
                                                          1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                                          1e12, 1e13, 1e14, 1e15, 1e16, 1e17};

// ---- bits and bytes of an image -------------------------------------------------------------

std::uint32_t byte_or_zero(ByteView image, std::size_t index) {
  return index < image.size() ? image[index] : 0;
}

/// Returns `bits` (1-32) bits of the image as a number. Bits past its end are 0.
std::uint32_t bits_at(ByteView image, std::size_t from_bit, std::uint32_t bits) {
  const std::size_t first = from_bit / 8;
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < 5; ++i)
    value |= static_cast<std::uint64_t>(byte_or_zero(image, first + i)) << (8 * i);
  value >>= from_bit % 8;
  return static_cast<std::uint32_t>(value & ((std::uint64_t{1} << bits) - 1));
}

/// The same for up to 64 bits.
std::uint64_t raw_at(ByteView image, std::size_t from_bit, std::uint32_t bits) {
  constexpr std::uint32_t kHalf = 32;
  if (bits <= kHalf) return bits_at(image, from_bit, bits);
  const std::uint64_t high = bits_at(image, from_bit + kHalf, bits - kHalf);
  return high << kHalf | bits_at(image, from_bit, kHalf);
}

void set_bits(Bytes& image, std::size_t to_bit, std::uint32_t bits, std::uint64_t value) {
  for (std::uint32_t i = 0; i < bits; ++i)
    if (value >> i & 1)
      image[(to_bit + i) / 8] |= static_cast<std::uint8_t>(1U << ((to_bit + i) % 8));
}

/// Converts between the number in image order (the first word is the lowest) and the value in the
/// device's order. Its own inverse.
std::uint64_t reordered(std::uint64_t number, std::uint32_t bits, ByteOrder order) {
  constexpr std::uint32_t kWordBits = 16;
  const bool high_first = order == ByteOrder::abcd || order == ByteOrder::badc;
  const bool swapped = order == ByteOrder::badc || order == ByteOrder::dcba;
  std::uint64_t out = 0;
  for (std::uint32_t at = 0; at < bits; at += kWordBits) {
    std::uint64_t word = number >> at & 0xFFFF;
    if (swapped) word = (word & 0xFF) << 8 | word >> 8;
    out |= word << (high_first ? bits - kWordBits - at : at);
  }
  return out;
}

// ---- numbers ----------------------------------------------------------------------------------

/// Returns the decimal places in the shortest spelling of `number`: 2 for 0.05, 7 for 1e-7, 0 for
/// 3.
int decimals_of(double number) {
  std::array<char, 64> text{};
  const auto end =
      std::to_chars(text.data(), text.data() + text.size(), number, std::chars_format::scientific)
          .ptr;
  const std::string_view digits(text.data(), static_cast<std::size_t>(end - text.data()));
  const auto e = digits.find('e');
  const auto point = digits.find('.');
  const int mantissa = point == std::string_view::npos ? 0 : static_cast<int>(e - point - 1);
  int exponent = 0;
  const std::size_t sign = digits[e + 1] == '+' ? 2 : 1;
  std::from_chars(digits.data() + e + sign, digits.data() + digits.size(), exponent);
  return std::max(0, mantissa - exponent);
}

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

double to_decimals(double value, int decimals) {
  if (decimals > kMaxDecimals) return value;
  const double power = kPowers[static_cast<std::size_t>(decimals)];
  const double shifted = value * power;
  return std::abs(shifted) < kExactDouble ? std::round(shifted) / power : value;
}

/// Returns the BCD digits of `raw` as a number; nullopt if a nibble is above 9.
std::optional<std::int64_t> from_bcd(std::uint32_t raw) {
  std::int64_t value = 0;
  for (int shift = 28; shift >= 0; shift -= 4) {
    const std::uint32_t digit = raw >> shift & 0xF;
    if (digit > 9) return std::nullopt;
    value = value * 10 + digit;
  }
  return value;
}

std::uint32_t to_bcd(std::int64_t value) {
  std::uint32_t raw = 0;
  for (int shift = 0; shift < 32; shift += 4) {
    raw |= static_cast<std::uint32_t>(value % 10) << shift;
    value /= 10;
  }
  return raw;
}

std::uint32_t bits_of_type(DataType type) {
  switch (type) {
    case DataType::boolean:
      return 1;
    case DataType::int16:
    case DataType::uint16:
    case DataType::bcd16:
      return 16;
    case DataType::int32:
    case DataType::uint32:
    case DataType::float32:
    case DataType::bcd32:
      return 32;
    case DataType::int64:
    case DataType::uint64:
    case DataType::float64:
      return 64;
    case DataType::string:
      break;
  }
  return 0;
}

/// Returns the bits of one element; 0 if the type does not fit the address unit.
std::uint32_t element_bits(const Point& point) {
  const std::uint32_t bits = bits_of_type(point.type);
  switch (point.address.unit) {
    case Unit::bit:
    case Unit::word_bit:
      return point.type == DataType::boolean ? 1 : 0;
    case Unit::word:
      if (point.type == DataType::boolean) return 0;
      return point.type == DataType::string ? (point.length + 1U) / 2 * 16 : bits;
    case Unit::dword:
      return point.type == DataType::int32 ? 32 : 0;
    case Unit::long_index:
    case Unit::long_count:
      return point.type == DataType::int32 || point.type == DataType::uint32 ? 32 : 0;
    case Unit::bit_group: {
      const std::uint32_t group = point.address.span.bits;
      const bool fits = group <= 16 ? bits == 16 : point.type == DataType::int32;
      return fits ? group : 0;
    }
  }
  return 0;
}

/// Range of the raw integer of one element. It always includes zero.
struct Limits {
  std::int64_t min = 0;
  std::uint64_t max = 0;
};

Limits limits_of(DataType type, std::uint32_t bits) {
  const std::uint64_t all_ones = ~std::uint64_t{0} >> (64 - bits);
  const auto half = static_cast<std::int64_t>(all_ones >> 1);
  switch (type) {
    case DataType::bcd16:
    case DataType::bcd32: {
      std::uint64_t power = 1;
      for (std::uint32_t digit = 0; digit < bits / 4; ++digit) power *= 10;
      return {0, power - 1};
    }
    // A group with fewer bits than its type is unsigned: K2M0 ranges from 0 to 255.
    case DataType::int16:
      if (bits == 16) return {-half - 1, all_ones >> 1};
      break;
    case DataType::int32:
      if (bits == 32) return {-half - 1, all_ones >> 1};
      break;
    case DataType::int64:
      return {-half - 1, all_ones >> 1};
    default:
      break;
  }
  return {0, all_ones};
}

// ---- text -------------------------------------------------------------------------------------

// A character of a PLC has eight bits, which are read as Latin-1. JSON needs UTF-8.
std::string utf8_from_latin1(std::uint8_t byte) {
  if (byte < 0x80) return std::string(1, static_cast<char>(byte));
  return {static_cast<char>(0xC0 | byte >> 6), static_cast<char>(0x80 | (byte & 0x3F))};
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

/// Returns the index of character number `i` in the image. Two characters fill a word. The first is
/// the low byte unless the order puts the most significant byte first.
std::size_t character_at(std::size_t i, ByteOrder order) {
  return order == ByteOrder::abcd ? i ^ 1U : i;
}

std::string hex_text(std::uint64_t raw, std::size_t digits) {
  constexpr std::size_t kHalf = 8;
  Bytes text;
  if (digits > kHalf)
    append_hex(text, static_cast<std::uint32_t>(raw >> 32), static_cast<int>(digits - kHalf));
  append_hex(text, static_cast<std::uint32_t>(raw), static_cast<int>(std::min(digits, kHalf)));
  return {text.begin(), text.end()};
}

// ---- reading ----------------------------------------------------------------------------------

Result<Scalar> number_from(const Point& point, const Whole& raw) {
  if (!point.scaled()) return scalar_of(raw);
  const auto nearest = raw.convert_to<double>();
  const double exact = nearest * point.scale + point.offset;
  if (!std::isfinite(exact)) return fail(ErrorCode::bad_request, "scaled value is not finite");
  // A double of 2^53 may stand for 2^53 + 1.
  if (std::abs(nearest) >= kExactDouble || std::abs(exact) >= kExactDouble)
    return scaled_exactly(raw, point.scale, point.offset);
  return Scalar(to_decimals(exact, point.decimals));
}

/// Decodes a float from its bit pattern `raw`.
template <class Float, class Pattern>
Result<Scalar> float_from(const Point& point, Pattern raw) {
  Float number = 0;
  static_assert(sizeof number == sizeof raw);
  std::memcpy(&number, &raw, sizeof number);
  if (!std::isfinite(number))
    return fail(ErrorCode::bad_request,
                hex_text(raw, 2 * sizeof raw) + (std::isnan(number) ? " is NaN" : " is infinite"));
  double value = widen(number);
  if (point.scaled())
    value = to_decimals(value * point.scale + point.offset, decimals_of(value) + point.decimals);
  if (!std::isfinite(value)) return fail(ErrorCode::bad_request, "scaled value is not finite");
  return Scalar(value);
}

Result<Scalar> element_from(const Point& point, ByteView image, std::size_t bit,
                            std::uint32_t bits) {
  if (point.type == DataType::boolean) return Scalar(bits_at(image, bit, 1) != 0);
  if (point.type == DataType::string) {
    std::string text;
    for (std::size_t i = 0; i < point.length; ++i) {
      const auto byte =
          static_cast<std::uint8_t>(byte_or_zero(image, bit / 8 + character_at(i, point.order)));
      if (byte == 0) break;
      text += utf8_from_latin1(byte);
    }
    return Scalar(std::move(text));
  }
  std::uint64_t raw = raw_at(image, bit, bits);
  if (point.address.unit == Unit::word) raw = reordered(raw, bits, point.order);
  if (point.type == DataType::float64) return float_from<double>(point, raw);
  if (point.type == DataType::float32)
    return float_from<float>(point, static_cast<std::uint32_t>(raw));
  if (point.type == DataType::bcd16 || point.type == DataType::bcd32) {
    const auto number = from_bcd(static_cast<std::uint32_t>(raw));
    if (!number) return fail(ErrorCode::bad_request, hex_text(raw, bits / 4) + " is not BCD");
    return number_from(point, *number);
  }
  Whole number(raw);
  if (raw > limits_of(point.type, bits).max) number -= Whole(1) << bits;
  return number_from(point, number);
}

// ---- writing ----------------------------------------------------------------------------------

tl::unexpected<PackError> bad_value(std::string text) {
  return tl::unexpected<PackError>(PackError{PackFault::bad_value, std::move(text)});
}
tl::unexpected<PackError> out_of_range(std::string text) {
  return tl::unexpected<PackError>(PackError{PackFault::out_of_range, std::move(text)});
}

using Packed = tl::expected<void, PackError>;

bool is_float(DataType type) { return type == DataType::float32 || type == DataType::float64; }

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
Packed check_scalar(const Point& point, const Scalar& given) {
  const Scalar scalar = without_quotes(point, given);
  const auto* whole = std::get_if<std::int64_t>(&scalar);
  const auto* real = std::get_if<double>(&scalar);
  if (real != nullptr && !std::isfinite(*real)) return bad_value("the value is not finite");
  const std::string type(to_string(point.type));
  if (point.type == DataType::boolean) {
    const bool bit = std::holds_alternative<bool>(scalar) ||
                     (whole != nullptr && (*whole == 0 || *whole == 1)) ||
                     (real != nullptr && (*real == 0.0 || *real == 1.0));
    if (!bit)
      return bad_value(type + " takes true, false, 1 or 0" + instead_of(scalar, point.type));
  } else if (point.type == DataType::string) {
    if (!std::holds_alternative<std::string>(scalar))
      return bad_value(type + " takes a text" + instead_of(scalar, point.type));
  } else if (!number_of(scalar)) {
    return bad_value(type + " takes a number" + instead_of(scalar, point.type));
  }
  return {};
}

/// Checks each element, and that the value has as many elements as the point.
Packed check_shape(const Point& point, const Value& value) {
  if (value.is_array != point.is_array)
    return bad_value(point.is_array ? "an array is expected"
                                    : "one value is expected, not an array");
  if (value.items.size() != point.count)
    return bad_value(std::to_string(value.items.size()) + " elements given, " +
                     std::to_string(point.count) + " expected");
  for (const Scalar& scalar : value.items)
    if (auto kind = check_scalar(point, scalar); !kind) return kind;
  return {};
}

/// Checks that the device can store the characters, if the scalar is a text.
Packed check_characters(const Scalar& scalar) {
  const auto* text = std::get_if<std::string>(&scalar);
  if (text != nullptr && !latin1_from_utf8(*text))
    return bad_value("the text has a character that is not Latin-1, or NUL");
  return {};
}

/// Returns (value − offset) ÷ scale. Corrects a quotient that misses a decimal only by the error of
/// binary fractions, so that 23.45 ÷ 0.1 is the exact tie 234.5.
double unscaled(const Point& point, double value) {
  if (!point.scaled()) return value;
  const double raw = (value - point.offset) / point.scale;
  constexpr double kGrid = 1e6;
  return std::abs(raw) * kGrid < kExactDouble ? std::round(raw * kGrid) / kGrid : raw;
}

double as_double(const Scalar& scalar) {
  if (const auto* flag = std::get_if<bool>(&scalar)) return *flag ? 1 : 0;
  return number_of(scalar).value_or(0);
}

/// Returns (value − offset) ÷ scale as the nearest raw integer, of any size.
Whole nearest_raw(const Point& point, const Scalar& scalar) {
  const double value = as_double(scalar);
  const double raw = unscaled(point, value);
  if (std::abs(value) < kExactDouble && std::abs(raw) < kExactDouble)
    return Whole(std::llround(raw));
  return unscaled_exactly(scalar, point.scale, point.offset);
}

template <class Float, class Pattern>
Packed pack_float(const Point& point, const Scalar& scalar, Bytes& image, std::size_t bit) {
  const double value = as_double(scalar);
  const double raw = point.scaled() ? (value - point.offset) / point.scale : value;
  if (!(std::abs(raw) <= double{std::numeric_limits<Float>::max()}))
    return out_of_range(spelled(value) + " does not fit a " + std::string(to_string(point.type)));
  const auto number = static_cast<Float>(raw);
  Pattern pattern = 0;
  static_assert(sizeof number == sizeof pattern);
  std::memcpy(&pattern, &number, sizeof pattern);
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
  const bool bcd = point.type == DataType::bcd16 || point.type == DataType::bcd32;
  std::uint64_t raw = nearest < 0 ? ~Whole(-nearest - 1).convert_to<std::uint64_t>()
                                  : nearest.convert_to<std::uint64_t>();
  if (bcd) raw = to_bcd(static_cast<std::int64_t>(raw));
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

/// Returns the types that fit the address, the default one first.
std::string types_of(const Address& address) {
  switch (address.unit) {
    case Unit::long_index:
      return "int32 or uint32";
    case Unit::long_count:
      return "uint32 or int32";
    default:
      return std::string(to_string(default_type(address)));
  }
}

}  // namespace

bool is_covered(Span span, std::span<const Span> ranges) {
  while (span.bits > 0) {
    const auto range = std::ranges::find_if(ranges, [&span](const Span& each) {
      return each.contains({span.space, span.first_bit, 1});
    });
    if (range == ranges.end()) return false;
    const std::uint32_t end = std::min(range->end_bit(), span.end_bit());
    span = {span.space, end, span.end_bit() - end};
  }
  return true;
}

// ---- names in the config -----------------------------------------------------------------------

std::string_view to_string(DataType type) { return kTypes[static_cast<std::size_t>(type)].text; }

Result<DataType> data_type_from(std::string_view word) {
  std::string all;
  for (const Word& known : kTypes) {
    if (known.text == word) return known.type;
    all += " " + std::string(known.text);
  }
  return fail(ErrorCode::bad_request, "'" + std::string(word) + "' is not a type; types are" + all);
}

Result<ByteOrder> byte_order_from(std::string_view word) {
  if (word == "ABCD" || word == "high_first") return ByteOrder::abcd;
  if (word == "CDAB" || word == "low_first") return ByteOrder::cdab;
  if (word == "BADC") return ByteOrder::badc;
  if (word == "DCBA") return ByteOrder::dcba;
  return fail(ErrorCode::bad_request,
              "'" + std::string(word) +
                  "' is not an order; orders are low_first high_first ABCD CDAB BADC DCBA");
}

std::string_view to_string(ByteOrder order) {
  constexpr std::array<std::string_view, 4> kOrders = {"ABCD", "CDAB", "BADC", "DCBA"};
  return kOrders[static_cast<std::size_t>(order)];
}

DataType default_type(const Address& address) {
  switch (address.unit) {
    case Unit::bit:
    case Unit::word_bit:
      return DataType::boolean;
    case Unit::dword:
    case Unit::long_index:
      return DataType::int32;
    case Unit::long_count:
      return DataType::uint32;
    case Unit::bit_group:
      return address.span.bits > 16 ? DataType::int32 : DataType::int16;
    case Unit::word:
      break;
  }
  return DataType::int16;
}

Result<void> set_units(Point& point, double scale, double offset) {
  if (!std::isfinite(scale) || !std::isfinite(offset) || scale == 0.0)
    return fail(ErrorCode::bad_request, "scale and offset are finite numbers, and scale is not 0");
  const bool plain = scale == 1.0 && offset == 0.0;
  if (!plain && (point.type == DataType::boolean || point.type == DataType::string))
    return fail(ErrorCode::bad_request,
                std::string(to_string(point.type)) + " takes no scale and no offset");
  point.scale = scale;
  point.offset = offset;
  point.decimals = static_cast<std::int8_t>(std::max(decimals_of(scale), decimals_of(offset)));
  return {};
}

Result<Span> span_of(const Point& point) {
  if (point.type == DataType::string && point.length == 0)
    return fail(ErrorCode::bad_request, "a string needs a length of at least 1 character");
  if (point.count == 0) return fail(ErrorCode::bad_request, "an array has at least 1 element");
  const std::uint32_t bits = element_bits(point);
  if (bits == 0)
    return fail(ErrorCode::bad_request, point.address.text + " cannot be read as " +
                                            std::string(to_string(point.type)) +
                                            "; its type must be " + types_of(point.address));
  const std::uint64_t total = std::uint64_t{bits} * point.count;
  if (point.address.span.first_bit + total > std::numeric_limits<std::uint32_t>::max())
    return fail(ErrorCode::bad_request, point.address.text + ": the array is too long");
  return Span{point.address.span.space, point.address.span.first_bit,
              static_cast<std::uint32_t>(total)};
}

std::optional<ValueRange> value_range(const Point& point) {
  const std::uint32_t bits = element_bits(point);
  if (bits == 0 || point.type == DataType::boolean || point.type == DataType::string)
    return std::nullopt;
  ValueRange range;
  if (is_float(point.type)) {
    const double most = std::abs(point.scale) * (point.type == DataType::float32
                                                     ? double{std::numeric_limits<float>::max()}
                                                     : std::numeric_limits<double>::max());
    range.least = point.offset - most;
    range.greatest = point.offset + most;
    return range;
  }
  const auto value_of_raw = [&](const Whole& raw) {
    const auto value = number_from(point, raw);
    return value ? as_double(*value) : raw.convert_to<double>() * point.scale + point.offset;
  };
  const Limits limits = limits_of(point.type, bits);
  range.least = point.scale < 0 ? value_of_raw(limits.max) : value_of_raw(limits.min);
  range.greatest = point.scale < 0 ? value_of_raw(limits.min) : value_of_raw(limits.max);
  range.step = std::abs(point.scale);
  return range;
}

std::optional<std::int64_t> values_within(const Point& point, std::optional<double> min,
                                          std::optional<double> max) {
  const auto range = value_range(point);
  if (!range || range->step == 0) return std::nullopt;
  // Clamp limits outside the range to its ends.
  const double first = std::clamp(min.value_or(range->least), range->least, range->greatest);
  const double last = std::clamp(max.value_or(range->greatest), range->least, range->greatest);
  if ((min && *min > range->greatest) || (max && *max < range->least) || first > last) return 0;
  double low = unscaled(point, first);
  double high = unscaled(point, last);
  if (point.scale < 0) std::swap(low, high);
  const double count = std::floor(high) - std::ceil(low) + 1;
  if (!std::isfinite(count) || std::abs(count) > kExactDouble) return std::nullopt;
  return static_cast<std::int64_t>(count);
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

std::optional<double> number_of(const Scalar& scalar) {
  if (const auto* whole = std::get_if<std::int64_t>(&scalar)) return static_cast<double>(*whole);
  if (const auto* real = std::get_if<double>(&scalar)) return *real;
  if (const auto* large = std::get_if<BigInteger>(&scalar))
    return Whole(large->digits).convert_to<double>();
  return std::nullopt;
}

// ---- values -------------------------------------------------------------------------------------

Result<Value> unpack(const Point& point, ByteView image, std::uint32_t image_first_bit) {
  const auto span = span_of(point);
  if (!span) return tl::make_unexpected(span.error());
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

tl::expected<Bytes, PackError> pack(const Point& point, const Value& value) {
  const auto span = span_of(point);
  if (!span) return bad_value(span.error().text);
  if (auto shape = check_shape(point, value); !shape)
    return tl::make_unexpected(std::move(shape.error()));
  for (const Scalar& scalar : value.items)
    if (auto characters = check_characters(scalar); !characters)
      return tl::make_unexpected(std::move(characters.error()));
  Bytes image((span->bits + 7) / 8, 0);
  const std::uint32_t bits = span->bits / point.count;
  std::size_t bit = 0;
  for (const Scalar& scalar : value.items) {
    if (auto packed = pack_element(point, scalar, image, bit, bits); !packed)
      return tl::make_unexpected(std::move(packed.error()));
    bit += bits;
  }
  return image;
}

Result<void> check_kind(const Point& point, const Value& value) {
  if (auto shape = check_shape(point, value); !shape)
    return fail(ErrorCode::bad_request, std::move(shape.error().text));
  return {};
}

bool shows(const Value& shown, const Value& wanted) {
  const auto same = [](const Scalar& is, const Scalar& should) {
    if (std::holds_alternative<std::string>(is)) return is == should;
    const auto* text = std::get_if<std::string>(&should);
    const auto whole = text != nullptr ? whole_from(*text) : std::nullopt;
    return compare(is, whole ? scalar_of(*whole) : should) == std::partial_ordering::equivalent;
  };
  return shown.is_array == wanted.is_array &&
         std::equal(shown.items.begin(), shown.items.end(), wanted.items.begin(),
                    wanted.items.end(), same);
}

Bytes extract_bits(ByteView image, std::uint32_t from_bit, std::uint32_t bits) {
  Bytes out((bits + 7) / 8, 0);
  for (std::uint32_t done = 0; done < bits; done += 8) {
    const std::uint32_t take = std::min<std::uint32_t>(8, bits - done);
    out[done / 8] = static_cast<std::uint8_t>(bits_at(image, std::size_t{from_bit} + done, take));
  }
  return out;
}

void insert_bits(Bytes& image, std::uint32_t to_bit, ByteView part, std::uint32_t bits) {
  for (std::uint32_t done = 0; done < bits; done += 8) {
    const std::uint32_t take = std::min<std::uint32_t>(8, bits - done);
    const std::size_t at = (std::size_t{to_bit} + done) / 8;
    const std::uint32_t shift = (to_bit + done) % 8;
    const std::uint32_t mask = ((1U << take) - 1) << shift;
    const std::uint32_t value = bits_at(part, done, take) << shift;
    image[at] = static_cast<std::uint8_t>((image[at] & ~mask) | value);
    if (mask > 0xFF)
      image[at + 1] = static_cast<std::uint8_t>((image[at + 1] & ~(mask >> 8)) | value >> 8);
  }
}

RangeEnds range_ends(std::string_view text) {
  const auto trimmed = [](std::string_view end) {
    const auto first = end.find_first_not_of(" \t");
    if (first == end.npos) return std::string_view();
    return end.substr(first, end.find_last_not_of(" \t") - first + 1);
  };
  for (const std::string_view between : {"..", "-"})
    if (const auto at = text.find(between); at != text.npos)
      return {trimmed(text.substr(0, at)), trimmed(text.substr(at + between.size()))};
  return {trimmed(text), std::nullopt};
}

}  // namespace fxagent
