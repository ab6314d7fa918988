// Values in the data types of Sparkplug, apart from the fields of a payload. Both payloads, B and
// C, have these types. Source: Sparkplug 3.0, section 6.4.16. Pure functions, any thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <type_traits>
#include <variant>

#include "agent/store/samples/sample_record.h"
#include "protocol/value/point.h"
#include "protocol/value/value.h"

namespace fxagent::sparkplug {

/// Numbers of the specification.
enum class Type : std::uint32_t {
  int8 = 1,  ///< commands only
  int16 = 2,
  int32 = 3,
  int64 = 4,
  uint16 = 6,
  uint32 = 7,
  uint64 = 8,
  real32 = 9,
  real64 = 10,
  boolean = 11,
  string = 12,
  int16_array = 23,
  int32_array = 24,
  int64_array = 25,
  uint16_array = 27,
  uint32_array = 28,
  uint64_array = 29,
  real32_array = 30,
  real64_array = 31,
  boolean_array = 32,
  string_array = 33
};

/// True for a scalar type of unsigned integers.
constexpr bool is_unsigned(Type type) {
  return type == Type::uint16 || type == Type::uint32 || type == Type::uint64;
}

/// Returns the data type of a tag's values in engineering units.
Type type_of(const Point& point);
/// Same for a value that was read.
Type type_of(const RecordedReading& reading);

/// All elements of an array, as they stand in a field of bytes.
struct Packed {
  std::string bytes;
};
/// A value as a field carries it. An integer has the sign of its type; monostate: no value.
using TypedValue = std::variant<std::monostate, bool, std::int64_t, std::uint64_t, float, double,
                                std::string, Packed>;

/// Returns monostate if `value` is of another kind than `type`. Does not check its range.
TypedValue typed(const Value& value, Type type);

/// Puts a value into the fields of a message, which both payloads name alike except for the
/// integers: `set_integer` gets those.
template <class Message, class SetInteger>
void put(Message& message, const TypedValue& value, const SetInteger& set_integer) {
  const auto set = [&](const auto& each) {
    using Each = std::remove_cvref_t<decltype(each)>;
    if constexpr (std::is_same_v<Each, std::monostate>)
      message.set_is_null(true);
    else if constexpr (std::is_same_v<Each, bool>)
      message.set_boolean_value(each);
    else if constexpr (std::is_same_v<Each, float>)
      message.set_float_value(each);
    else if constexpr (std::is_same_v<Each, double>)
      message.set_double_value(each);
    else if constexpr (std::is_same_v<Each, std::string>)
      message.set_string_value(each);
    else if constexpr (std::is_same_v<Each, Packed>)
      message.set_bytes_value(each.bytes);
    else
      set_integer(each);
  };
  std::visit(set, value);
}

/// Returns the value in the fields of a message, the reverse of put(). `integer` returns that of an
/// integer field, or monostate if none is set.
template <class Message, class Integer>
TypedValue taken(const Message& message, const Integer& integer) {
  if (message.has_float_value()) return message.float_value();
  if (message.has_double_value()) return message.double_value();
  if (message.has_boolean_value()) return message.boolean_value();
  if (message.has_string_value()) return message.string_value();
  if (message.has_bytes_value()) return Packed{message.bytes_value()};
  return integer();
}

/// Returns a received value as JSON, an array element by element as `type` says. nullopt: there is
/// no value, or its bytes are not an array of that type.
std::optional<std::string> json_of(const TypedValue& value, Type type);

}  // namespace fxagent::sparkplug
