// Values of tags and commands: comparison and human-readable spelling.
#pragma once

#include <boost/container/small_vector.hpp>
#include <compare>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <variant>

namespace fxagent {

/// An integer outside the range of int64, in decimal digits with a minus if it is negative.
struct BigInteger {
  std::string digits;
  friend bool operator==(const BigInteger&, const BigInteger&) = default;
};

/// An integer is stored as an int64 if it fits, otherwise as a BigInteger.
using Scalar = std::variant<bool, std::int64_t, double, std::string, BigInteger>;

/// Elements of a value. A single element is stored in place.
using Scalars = boost::container::small_vector<Scalar, 1>;

/// A value in engineering units: one scalar, or one for each element of an array.
struct Value {
  Scalars items;
  bool is_array = false;

  Value() = default;
  explicit Value(Scalar scalar) { items.push_back(std::move(scalar)); }
  static Value array(Scalars elements) {
    Value v;
    v.items = std::move(elements);
    v.is_array = true;
    return v;
  }
  friend bool operator==(const Value&, const Value&) = default;
};

/// True if `shown`, a value from unpack(), equals `wanted`, which must pass check_kind(): the same
/// text, the same number (-0 is 0), true for 1 and false for 0.
bool shows(const Value& shown, const Value& wanted);

/// Returns the nearest double of a number; nullopt for a bool or a text.
std::optional<double> number_of(const Scalar& scalar);
/// Returns the nearest double of a number, 1 or 0 for a bool, and 0 for a text.
double as_double(const Scalar& scalar);
/// Compares two numbers exactly, even if their nearest doubles are equal. A bool counts as 0 or 1.
/// Returns nullopt if either is a text.
std::optional<std::partial_ordering> compare(const Scalar& one, const Scalar& other);

/// Returns the shortest spelling that reads back as the same number: "1000", "0.5".
std::string spelled(double number);
/// The same for any number or bool. Returns a text unchanged.
std::string spelled(const Scalar& scalar);

}  // namespace fxagent
