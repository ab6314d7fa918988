// Points and values: places in a device, their types, and the values read from or written to them.
//
// A codec maps its device names to *spaces*. A space is a run of device memory of one kind (D, M,
// CN200-CN255, holding registers …), counted in bits from its first device. Whatever the wire
// format, a codec returns the content of a space as an *image*: bit n of the span is bit n % 8 of
// byte n / 8, and a 16-bit word lies low byte first. So one planner, one packer and one allow list
// serve every protocol.
#pragma once

#include <boost/container/small_vector.hpp>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "protocol/value/bytes.h"
#include "protocol/value/result.h"
#include "protocol/value/short_text.h"

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

/// True if every bit of `span` lies in one of the ranges.
bool is_covered(Span span, std::span<const Span> ranges);

/// True if the two spans have a bit in common.
inline bool overlap(const Span& one, const Span& other) {
  return one.space == other.space && one.first_bit < other.end_bit() &&
         other.first_bit < one.end_bit();
}

/// The store saves these numbers with its samples (agent/store/README.md): only append new ones.
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

/// Convert between a type and its word in the config ("bool", "int16" …). Error: bad_request lists
/// the words.
std::string_view to_string(DataType type);
Result<DataType> data_type_from(std::string_view word);

/// Byte order of a value, named by the letters used for Modbus: A is the most significant of the
/// four bytes of a 32-bit value. `abcd` and `badc` put the high word first. `cdab` (the order of FX
/// double-word instructions) and `dcba` put the low word first. The same holds for the four words
/// of a 64-bit value. `badc` and `dcba` also swap the bytes of each word. In a string the first of
/// the two characters of a word is the low byte, as FX instructions have it; with `abcd` it is the
/// high byte.
enum class ByteOrder : std::uint8_t { abcd, cdab, badc, dcba };

/// Parses ABCD CDAB BADC DCBA, `low_first` (= CDAB) and `high_first` (= ABCD).
Result<ByteOrder> byte_order_from(std::string_view word);
std::string_view to_string(ByteOrder order);

/// Shape of the memory that an address names. It decides which types fit.
enum class Unit : std::uint8_t {
  bit,         ///< one bit, written by force on/off (coil, M, X, Y …)
  word,        ///< 16 bits
  dword,       ///< one 32-bit device (CN200-CN255): int32 only
  long_index,  ///< one 32-bit device with or without a sign (LZ): int32, uint32
  long_count,  ///< one 32-bit device that counts from 0 to 4294967295 (LCN, LTN, LSTN): uint32,
               ///< int32
  bit_group,   ///< K1-K8 groups: 4 to 32 bits of a bit device, as a number
  word_bit,    ///< one bit inside a word (D100.F)
};

/// A device address as parsed by its protocol. `span` covers one element.
struct Address {
  ShortText text;  ///< canonical spelling: "D200", "Y17", "K4M0", "TN5"
  Span span;
  Unit unit = Unit::word;
  /// False if this kind of device cannot be written (D100.F, input registers).
  bool writable = true;
  friend bool operator==(const Address&, const Address&) = default;
};

/// Returns the type of a tag whose config names none: bool for bits, int16 for words and K1-K4,
/// int32 for CN200-CN255, LZ and K5-K8, uint32 for LCN, LTN and LSTN.
DataType default_type(const Address& address);

/// One tag: a place, how to decode it, and its engineering units.
struct Point {
  Address address;
  DataType type = DataType::int16;
  ByteOrder order = ByteOrder::cdab;
  std::uint16_t count = 1;   ///< elements of an array; 1 with is_array false is a plain value
  std::uint16_t length = 0;  ///< characters of a string; 0 for other types
  bool is_array = false;
  /// Decimal places that scale and offset can produce; see set_units().
  std::int8_t decimals = 0;
  double scale = 1.0;
  double offset = 0.0;

  bool scaled() const { return scale != 1.0 || offset != 0.0; }
  friend bool operator==(const Point&, const Point&) = default;
};

/// Stores scale and offset, and derives `decimals`, so that 234 × 0.1 reads 23.4 and not
/// 23.400000000000002. Error: bad_request if scale is 0 or either is NaN or infinite, or if the
/// type takes no scale (bool, string).
Result<void> set_units(Point& point, double scale, double offset);

/// Returns every bit that the point occupies. Error: bad_request if the type does not fit the
/// address unit (int16 on a bit, int16 on CN200 …), or if the array ends beyond the 32-bit range of
/// bit numbers.
Result<Span> span_of(const Point& point);

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

/// Decodes the point's value from `image`, whose first bit is `image_first_bit` of the point's
/// space. Errors: unsupported (the point is not wholly inside the image), or bad_request with the
/// text for `bad_value` (NaN, infinite, a nibble that is not BCD). Never bad_frame.
Result<Value> unpack(const Point& point, ByteView image, std::uint32_t image_first_bit);

/// Kind of a failure of pack(): the value has the wrong kind or count, or it is out of range.
enum class PackFault : std::uint8_t { bad_value, out_of_range };
struct PackError {
  PackFault fault = PackFault::bad_value;
  std::string text;
};
/// Returns the raw image of span_of(point) that writes `value`: (value − offset) ÷ scale, rounded
/// to the nearest integer, ties away from zero. An integer type also takes an integer in a text if
/// its samples may have one: beyond ±2^53, and any integer for the 64-bit types.
tl::expected<Bytes, PackError> pack(const Point& point, const Value& value);

/// Checks that `value` has the kind and the number of elements that the point takes. Does not check
/// its range. Error: bad_request states what the point takes.
Result<void> check_kind(const Point& point, const Value& value);
/// True if `shown`, a value from unpack(), equals `wanted`, which must pass check_kind(): the same
/// text, the same number (-0 is 0), true for 1 and false for 0.
bool shows(const Value& shown, const Value& wanted);

/// Copies `bits` bits of `image`, from bit `from_bit`, to a new image that starts at bit 0. Bits
/// past the end of `image` read as 0.
Bytes extract_bits(ByteView image, std::uint32_t from_bit, std::uint32_t bits);
/// Overwrites `bits` bits of `image`, from bit `to_bit`, with the first bits of `part`. `image`
/// must hold them all.
void insert_bits(Bytes& image, std::uint32_t to_bit, ByteView part, std::uint32_t bits);

/// The ends of a range as it is written, "M100-M199" or "M100..M199". For any other text, `first`
/// is the whole text and `last` is empty.
struct RangeEnds {
  std::string_view first;
  std::optional<std::string_view> last;
};
RangeEnds range_ends(std::string_view text);

}  // namespace fxagent
