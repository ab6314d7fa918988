// Points: places in a device, their types and engineering units.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "protocol/value/result.h"
#include "protocol/value/short_text.h"
#include "protocol/value/span.h"

namespace fxagent {

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

/// Returns the bits of one number of the type; 0 for a string.
std::uint32_t bits_of_type(DataType type);
/// Returns the bits of one element; 0 if the type does not fit the address unit.
std::uint32_t element_bits(const Point& point);

/// Range of the values of one element, in engineering units.
struct ValueRange {
  double least = 0;
  double greatest = 0;
  double step = 0;  ///< distance between neighbouring values; 0 for floats, whose steps vary
};
/// Returns nullopt for bool and string, and if the type does not fit the address unit.
std::optional<ValueRange> value_range(const Point& point);
/// Returns the number of values of one element within these limits, both inclusive. nullopt if
/// value_range() has no single step.
std::optional<std::int64_t> values_within(const Point& point, std::optional<double> min,
                                          std::optional<double> max);

}  // namespace fxagent
