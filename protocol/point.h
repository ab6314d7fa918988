// What can be read or written, and what was: places in a device, their types, their values.
//
// A codec maps its device names to *spaces*. A space is a run of device memory of one kind (D, M,
// CN200-CN255, holding registers …), counted in bits from its first device. Whatever the wire
// format, a codec hands over the content of a space as an *image*: bit n of the span is bit n % 8
// of byte n / 8, and a 16-bit word lies low byte first. So one planner, one packer and one allow
// list serve every protocol.
#pragma once

#include <boost/container/small_vector.hpp>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "protocol/bytes.h"
#include "protocol/result.h"
#include "protocol/short_text.h"

namespace fxagent {

/// A run of bits in one space of a codec.
struct Span {
  std::uint16_t space = 0;
  std::uint32_t first_bit = 0;
  std::uint32_t bits = 0;

  std::uint32_t end_bit() const { return first_bit + bits; }
  bool contains(const Span& other) const {
    return space == other.space && first_bit <= other.first_bit && other.end_bit() <= end_bit();
  }
  friend bool operator==(const Span&, const Span&) = default;
};

/// Whether each bit of `span` is in one of the ranges.
bool is_covered(Span span, std::span<const Span> ranges);

/// Whether the two have a bit in common.
inline bool overlap(const Span& one, const Span& other) {
  return one.space == other.space && one.first_bit < other.end_bit() &&
         other.first_bit < one.end_bit();
}

/// Stored samples have these numbers (agent/store/README.md): add at the end.
enum class DataType : std::uint8_t {
  boolean,
  int16,
  uint16,
  int32,
  uint32,
  float32,
  bcd16,
  bcd32,
  string,
  int64,
  uint64,
  float64
};

/// The config's word for a type ("bool", "int16" …), and back; bad_request lists the words.
std::string_view to_string(DataType type);
Result<DataType> data_type_from(std::string_view word);

/// Order of the bytes of a value, named by the letters used for Modbus: A is the most significant
/// of the four bytes of a 32-bit value. `abcd` and `badc` put the high word first, `cdab` (the
/// order of FX double-word instructions) and `dcba` the low word; so they do with the four words of
/// a 64-bit value. `badc` and `dcba` also swap the bytes of each word. In a string the first of the
/// two characters of a word is the low byte, as FX instructions have it; with `abcd` it is the high
/// byte.
enum class ByteOrder : std::uint8_t { abcd, cdab, badc, dcba };

/// Accepts ABCD CDAB BADC DCBA, `low_first` (= CDAB) and `high_first` (= ABCD).
Result<ByteOrder> byte_order_from(std::string_view word);
std::string_view to_string(ByteOrder order);

/// The shape of what an address names; it decides which types fit.
enum class Unit : std::uint8_t {
  bit,         ///< one bit, written by force on/off (coil, M, X, Y …)
  word,        ///< 16 bits
  dword,       ///< one 32-bit device (CN200-CN255): int32 only
  long_index,  ///< one 32-bit device with or without a sign (LZ): int32, uint32
  long_count,  ///< one that counts from 0 to 4294967295 (LCN, LTN, LSTN): uint32, int32
  bit_group,   ///< K1-K8 groups: 4 to 32 bits of a bit device, as a number
  word_bit,    ///< one bit inside a word (D100.F)
};

/// A device address as its protocol understands it. `span` covers one element.
struct Address {
  ShortText text;  ///< canonical spelling: "D200", "Y17", "K4M0", "TN5"
  Span span;
  Unit unit = Unit::word;
  bool writable =
      true;  ///< false where the device kind cannot be written (D100.F, input registers)
  friend bool operator==(const Address&, const Address&) = default;
};

/// What a tag is where its config names no type: bool for bits, int16 for words and K1-K4, int32
/// for CN200-CN255, LZ and K5-K8, uint32 for LCN, LTN and LSTN.
DataType default_type(const Address& address);

/// One tag's data: a place, how to read it, and its engineering units.
struct Point {
  Address address;
  DataType type = DataType::int16;
  ByteOrder order = ByteOrder::cdab;
  std::uint16_t count = 1;   ///< elements of an array; 1 with is_array false is a plain value
  std::uint16_t length = 0;  ///< characters of a string; 0 for other types
  bool is_array = false;
  /// Digits after the point that scale and offset can produce; see set_units().
  std::int8_t decimals = 0;
  double scale = 1.0;
  double offset = 0.0;

  bool scaled() const { return scale != 1.0 || offset != 0.0; }
  friend bool operator==(const Point&, const Point&) = default;
};

/// Stores scale and offset, and works out `decimals`, so that 234 × 0.1 reads 23.4 and not
/// 23.400000000000002. bad_request: scale 0, NaN or Inf; or a type that takes no scale (bool,
/// string).
Result<void> set_units(Point& point, double scale, double offset);

/// Every bit that the point occupies. bad_request where the type does not fit the address unit
/// (int16 on a bit, int16 on CN200 …) or the array runs past the numbers that 32 bits can count.
Result<Span> span_of(const Point& point);

/// An integer that an int64 does not hold, in decimal digits with a minus where it is negative.
struct BigInteger {
  std::string digits;
  friend bool operator==(const BigInteger&, const BigInteger&) = default;
};

/// An integer is an int64 where that holds it.
using Scalar = std::variant<bool, std::int64_t, double, std::string, BigInteger>;

/// The elements of a value; a single one lies in place.
using Scalars = boost::container::small_vector<Scalar, 1>;

/// One value in engineering units: a scalar, or as many as the array has.
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

/// The point's value out of `image`, whose first bit is `image_first_bit` of the point's space.
/// bad_frame is never returned; the only errors are unsupported (the point is not wholly inside the
/// image) and bad_request with a text for `bad_value` (NaN, Inf, a nibble that is not BCD).
Result<Value> unpack(const Point& point, ByteView image, std::uint32_t image_first_bit);

/// The raw image of span_of(point) that writes `value`: (value − offset) ÷ scale, to the nearest
/// integer, ties away from zero. An integer type takes an integer in a text where samples have one:
/// beyond ±2^53, and any for the types of 64 bits. bad_request: wrong kind of value or count
/// ("bad_value" class); out of range is told apart by text only through `OutOfRange` below.
enum class PackFault : std::uint8_t { bad_value, out_of_range };
struct PackError {
  PackFault fault = PackFault::bad_value;
  std::string text;
};
tl::expected<Bytes, PackError> pack(const Point& point, const Value& value);

/// Whether `value` is of the kind and has the number of elements that the point takes, whatever its
/// size. bad_request says what is wanted.
Result<void> check_kind(const Point& point, const Value& value);
/// Whether `shown`, a value that unpack() made, is `wanted`, which check_kind() lets through: the
/// same text, the same number (-0 is 0), true for 1 and false for 0.
bool shows(const Value& shown, const Value& wanted);

/// Copies `bits` bits of `image`, starting `from_bit` bits in, to a fresh image that starts at bit
/// 0; bits past the end of `image` read as 0.
Bytes extract_bits(ByteView image, std::uint32_t from_bit, std::uint32_t bits);
/// Overwrites `bits` bits of `image` from `to_bit` on with the first ones of `part`. `image` holds
/// them all.
void insert_bits(Bytes& image, std::uint32_t to_bit, ByteView part, std::uint32_t bits);

/// The ends of a range as they are written, "M100-M199" or "M100..M199"; of a text that is none,
/// all of it and no last one.
struct RangeEnds {
  std::string_view first;
  std::optional<std::string_view> last;
};
RangeEnds range_ends(std::string_view text);

}  // namespace fxagent
