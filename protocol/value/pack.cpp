#include "protocol/value/pack.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <string_view>
#include <utility>

#include "protocol/value/kind.h"
#include "protocol/value/raw.h"

namespace fxagent {
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

}  // namespace fxagent
