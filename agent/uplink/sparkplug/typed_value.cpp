#include "agent/uplink/sparkplug/typed_value.h"

#include <array>
#include <bit>
#include <cstddef>
#include <string_view>
#include <utility>

#include "agent/text/json_writer.h"
#include "agent/text/text.h"

namespace fxagent::sparkplug {
namespace {

Type scalar_type(DataType type, bool scaled) {
  // In the order of DataType.
  constexpr std::array kTypes{Type::boolean, Type::int16,  Type::uint16, Type::int32,
                              Type::uint32,  Type::real32, Type::uint16, Type::uint32,
                              Type::string,  Type::int64,  Type::uint64, Type::real64};
  static_assert(kTypes.size() == static_cast<std::size_t>(DataType::float64) + 1);
  return scaled ? Type::real64 : kTypes[static_cast<std::size_t>(type)];
}

/// Number of an array type, less that of its elements.
constexpr int kArray = 21;
static_assert(static_cast<int>(Type::boolean_array) == static_cast<int>(Type::boolean) + kArray);
static_assert(static_cast<int>(Type::string_array) == static_cast<int>(Type::string) + kArray);

Type array_of(Type type) { return static_cast<Type>(static_cast<int>(type) + kArray); }
Type element_of(Type type) { return static_cast<Type>(static_cast<int>(type) - kArray); }
bool is_array(Type type) { return type >= Type::int16_array; }

std::size_t bytes_of(Type type) {
  if (type == Type::int16 || type == Type::uint16) return 2;
  return type == Type::int32 || type == Type::uint32 || type == Type::real32 ? 4 : 8;
}

/// Returns the 64 bits of an integer; nullopt if it is not one.
std::optional<std::uint64_t> integer_bits(const Scalar& scalar) {
  if (const auto* number = std::get_if<std::int64_t>(&scalar))
    return static_cast<std::uint64_t>(*number);
  const auto* big = std::get_if<BigInteger>(&scalar);
  return big == nullptr ? std::nullopt : number_from<std::uint64_t>(big->digits);
}

/// Returns the element as the number of little-endian bytes that its type has in an array.
std::optional<std::uint64_t> packed_bits(const Scalar& scalar, Type type) {
  if (type == Type::real32 || type == Type::real64) {
    const auto number = number_of(scalar);
    if (!number) return std::nullopt;
    if (type == Type::real64) return std::bit_cast<std::uint64_t>(*number);
    return std::bit_cast<std::uint32_t>(static_cast<float>(*number));
  }
  return integer_bits(scalar);
}

std::optional<std::string> packed(const Scalars& items, Type type) {
  std::string out;
  const auto put = [&out](std::uint64_t bits, std::size_t bytes) {
    for (std::size_t i = 0; i < bytes; ++i) out += static_cast<char>((bits >> (8 * i)) & 0xFF);
  };
  if (type == Type::boolean) {
    put(items.size(), 4);
    for (std::size_t i = 0; i < items.size(); ++i) {
      const auto* bit = std::get_if<bool>(&items[i]);
      if (bit == nullptr) return std::nullopt;
      if (i % 8 == 0) out += '\0';
      if (*bit) out.back() = static_cast<char>(out.back() | (0x80 >> (i % 8)));
    }
    return out;
  }
  for (const Scalar& item : items) {
    if (const auto* text = std::get_if<std::string>(&item); text != nullptr) {
      if (type != Type::string) return std::nullopt;
      out += *text;
      out += '\0';
      continue;
    }
    const auto bits = packed_bits(item, type);
    if (!bits || type == Type::string) return std::nullopt;
    put(*bits, bytes_of(type));
  }
  return out;
}

/// Reads `count` little-endian bytes at the front and removes them.
std::uint64_t take_bits(std::string_view& bytes, std::size_t count) {
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < count; ++i)
    bits |= std::uint64_t{static_cast<std::uint8_t>(bytes[i])} << (8 * i);
  bytes.remove_prefix(count);
  return bits;
}

/// Writes the bits of an element as the number that they are.
void write_number(json::Writer& out, std::uint64_t bits, Type type) {
  switch (type) {
    case Type::int16:
      return void(out.integer(std::int64_t{static_cast<std::int16_t>(bits)}));
    case Type::int32:
      return void(out.integer(std::int64_t{static_cast<std::int32_t>(bits)}));
    case Type::int64:
      return void(out.integer(static_cast<std::int64_t>(bits)));
    case Type::real32:
      return void(out.number(std::bit_cast<float>(static_cast<std::uint32_t>(bits))));
    case Type::real64:
      return void(out.number(std::bit_cast<double>(bits)));
    default:
      return void(out.integer(bits));
  }
}

/// Returns false, having written a part, if the bytes are not an array of this type.
bool write_elements(json::Writer& out, std::string_view bytes, Type type) {
  if (type == Type::boolean) {
    if (bytes.size() < 4) return false;
    const std::uint64_t count = take_bits(bytes, 4);
    if (bytes.size() != (count + 7) / 8) return false;
    for (std::size_t i = 0; i < count; ++i)
      out.boolean((static_cast<std::uint8_t>(bytes[i / 8]) & (0x80U >> (i % 8))) != 0);
    return true;
  }
  if (type == Type::string) {
    for (std::size_t end = 0; !bytes.empty(); bytes.remove_prefix(end + 1)) {
      end = bytes.find('\0');
      if (end == bytes.npos) return false;
      out.string(bytes.substr(0, end));
    }
    return true;
  }
  if (bytes.size() % bytes_of(type) != 0) return false;
  while (!bytes.empty()) write_number(out, take_bits(bytes, bytes_of(type)), type);
  return true;
}

}  // namespace

Type type_of(const Point& point) {
  const Type type = scalar_type(point.type, point.scaled());
  return point.is_array ? array_of(type) : type;
}

Type type_of(const RecordedReading& reading) {
  const Type type = scalar_type(reading.type, reading.scaled);
  return reading.value.is_array ? array_of(type) : type;
}

TypedValue typed(const Value& value, Type type) {
  if (value.is_array != is_array(type) || (!value.is_array && value.items.empty())) return {};
  if (value.is_array) {
    auto bytes = packed(value.items, element_of(type));
    return bytes ? TypedValue(Packed{std::move(*bytes)}) : TypedValue();
  }
  const Scalar& scalar = value.items[0];
  const auto held = [](const auto* item) {
    return item != nullptr ? TypedValue(*item) : TypedValue();
  };
  if (type == Type::boolean) return held(std::get_if<bool>(&scalar));
  if (type == Type::string) return held(std::get_if<std::string>(&scalar));
  if (type == Type::real32 || type == Type::real64) {
    const auto number = number_of(scalar);
    if (!number) return {};
    return type == Type::real64 ? TypedValue(*number) : TypedValue(static_cast<float>(*number));
  }
  const auto bits = integer_bits(scalar);
  if (!bits) return {};
  return is_unsigned(type) ? TypedValue(*bits) : TypedValue(static_cast<std::int64_t>(*bits));
}

std::optional<std::string> json_of(const TypedValue& value, Type type) {
  json::Writer out;
  if (const auto* array = std::get_if<Packed>(&value)) {
    out.begin_array();
    if (!is_array(type) || !write_elements(out, array->bytes, element_of(type)))
      return std::nullopt;
    return out.end_array().take();
  }
  if (const auto* flag = std::get_if<bool>(&value)) return out.boolean(*flag).take();
  // A number even beyond 2^53: as a text it would fit a string tag.
  if (const auto* number = std::get_if<std::int64_t>(&value)) return std::to_string(*number);
  if (const auto* number = std::get_if<std::uint64_t>(&value)) return std::to_string(*number);
  if (const auto* number = std::get_if<float>(&value)) return out.number(*number).take();
  if (const auto* number = std::get_if<double>(&value)) return out.number(*number).take();
  if (const auto* text = std::get_if<std::string>(&value)) return out.string(*text).take();
  return std::nullopt;
}

}  // namespace fxagent::sparkplug
