#include "protocol/value/unpack.h"

#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <string>
#include <utility>

#include "protocol/value/raw.h"

namespace fxagent {
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
  Float number = 0;
  static_assert(sizeof number == sizeof raw);
  std::memcpy(&number, &raw, sizeof number);
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

}  // namespace fxagent
