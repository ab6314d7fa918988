#include "agent/store/samples/sample_record.h"

#include <bit>
#include <cstddef>
#include <utility>

namespace fxagent {
namespace {

// RFC 8949, section 3.1: the upper three bits of an item's first byte.
enum class Major : std::uint8_t { whole = 0, negative = 1, bytes = 2, text = 3, array = 4 };
// The lower five bits: the number itself below 24, else the code of its size in bytes.
constexpr std::uint8_t kOneByte = 24;
constexpr std::uint8_t kEightBytes = 27;
// RFC 8949, section 3.3.
constexpr std::uint8_t kFalse = 0xF4;
constexpr std::uint8_t kTrue = 0xF5;
constexpr std::uint8_t kNull = 0xF6;
constexpr std::uint8_t kFloat32 = 0xFA;
constexpr std::uint8_t kFloat64 = 0xFB;

constexpr std::size_t kHeadItems = 6;  // before the first tag
constexpr std::size_t kGoodItems = 3;
constexpr std::size_t kBadItems = 6;
constexpr std::uint64_t kPartial = 1;
constexpr std::uint64_t kWritten = 2;
// A tag's kind: its type in the lower four bits, plus these flags.
constexpr std::uint64_t kTypeBits = 15;
constexpr std::uint64_t kScaled = 16;
constexpr std::uint64_t kBad = 32;

class RowWriter final {
 public:
  explicit RowWriter(std::size_t expected) { row_.reserve(expected); }

  void head(Major major, std::uint64_t number) {
    const auto upper = static_cast<std::uint8_t>(static_cast<unsigned>(major) << 5);
    if (number < kOneByte) return byte(static_cast<std::uint8_t>(upper | number));
    const int power = number <= 0xFF ? 0 : number <= 0xFFFF ? 1 : number <= 0xFFFFFFFF ? 2 : 3;
    byte(static_cast<std::uint8_t>(upper | (kOneByte + power)));
    big_endian(number, 1 << power);
  }
  void integer(std::int64_t value) {
    const auto bits = static_cast<std::uint64_t>(value);
    value < 0 ? head(Major::negative, ~bits) : head(Major::whole, bits);
  }
  /// Writes four bytes if they hold the same value, else eight.
  void real(double value) {
    const auto single = static_cast<float>(value);
    if (std::bit_cast<std::uint64_t>(static_cast<double>(single)) ==
        std::bit_cast<std::uint64_t>(value)) {
      byte(kFloat32);
      big_endian(std::bit_cast<std::uint32_t>(single), sizeof single);
    } else {
      byte(kFloat64);
      big_endian(std::bit_cast<std::uint64_t>(value), sizeof value);
    }
  }
  void string(Major major, std::string_view value) {
    head(major, value.size());
    row_ += value;
  }
  void byte(std::uint8_t value) { row_ += static_cast<char>(value); }
  std::string take() { return std::move(row_); }

 private:
  void big_endian(std::uint64_t number, int bytes) {
    char text[8];
    for (int i = 0; i < bytes; ++i) text[i] = static_cast<char>(number >> (8 * (bytes - 1 - i)));
    row_.append(text, static_cast<std::size_t>(bytes));
  }

  std::string row_;
};

void write_scalar(RowWriter& out, const Scalar& scalar) {
  if (const auto* integer = std::get_if<std::int64_t>(&scalar))
    out.integer(*integer);
  else if (const auto* real = std::get_if<double>(&scalar))
    out.real(*real);
  else if (const auto* flag = std::get_if<bool>(&scalar))
    out.byte(*flag ? kTrue : kFalse);
  else if (const auto* large = std::get_if<BigInteger>(&scalar))
    out.string(Major::text, large->digits);
  else  // PLC strings need not be UTF-8, CBOR's text must be
    out.string(Major::bytes, std::get<std::string>(scalar));
}

void write_value(RowWriter& out, const Value& value) {
  if (value.is_array) {
    out.head(Major::array, value.items.size());
    for (const Scalar& item : value.items) write_scalar(out, item);
  } else if (value.items.empty()) {
    out.byte(kNull);
  } else {
    write_scalar(out, value.items.front());
  }
}

/// Each function returns false if the next item is something else, or the row ends.
class RowReader final {
 public:
  explicit RowReader(std::string_view row) : rest_(row) {}

  bool at_end() const { return rest_.empty(); }
  bool count(Major major, std::uint64_t& number) {
    if (rest_.empty() || first() >> 5 != static_cast<unsigned>(major)) return false;
    const unsigned lower = first() & 31U;
    rest_.remove_prefix(1);
    if (lower < kOneByte) {
      number = lower;
      return true;
    }
    return lower <= kEightBytes && big_endian(std::size_t{1} << (lower - kOneByte), number);
  }
  bool integer(std::int64_t& value) {
    std::uint64_t bits = 0;
    const bool negative = !rest_.empty() && first() >> 5 == 1U;
    if (!count(negative ? Major::negative : Major::whole, bits) || bits >> 63 != 0) return false;
    value = static_cast<std::int64_t>(negative ? ~bits : bits);
    return true;
  }
  bool real(double& value) {
    std::uint64_t bits = 0;
    const bool is_single = takes(kFloat32);
    if (!is_single && !takes(kFloat64)) return false;
    if (!big_endian(is_single ? sizeof(float) : sizeof(double), bits)) return false;
    value = is_single ? std::bit_cast<float>(static_cast<std::uint32_t>(bits))
                      : std::bit_cast<double>(bits);
    return true;
  }
  bool string(Major major, std::string_view& value) {
    std::uint64_t size = 0;
    if (!count(major, size) || size > rest_.size()) return false;
    value = rest_.substr(0, static_cast<std::size_t>(size));
    rest_.remove_prefix(value.size());
    return true;
  }
  /// Consumes the next byte if it is `wanted`; else returns false.
  bool takes(std::uint8_t wanted) {
    if (rest_.empty() || first() != wanted) return false;
    rest_.remove_prefix(1);
    return true;
  }
  bool scalar(Scalar& value);
  bool value(Value& value);

 private:
  unsigned first() const { return static_cast<std::uint8_t>(rest_.front()); }
  bool big_endian(std::size_t bytes, std::uint64_t& number) {
    if (rest_.size() < bytes) return false;
    number = 0;
    for (std::size_t i = 0; i < bytes; ++i)
      number = number << 8 | static_cast<std::uint8_t>(rest_[i]);
    rest_.remove_prefix(bytes);
    return true;
  }

  std::string_view rest_;
};

bool RowReader::scalar(Scalar& value) {
  if (rest_.empty()) return false;
  std::string_view text;
  switch (first() >> 5) {
    case 0:
    case 1:
      return integer(value.emplace<std::int64_t>());
    case 2:
      if (!string(Major::bytes, text)) return false;
      value.emplace<std::string>(text);
      return true;
    case 3:
      if (!string(Major::text, text)) return false;
      value.emplace<BigInteger>(BigInteger{std::string(text)});
      return true;
    default:
      break;
  }
  if (takes(kTrue)) return value.emplace<bool>(true);
  if (takes(kFalse)) return !value.emplace<bool>(false);
  return real(value.emplace<double>());
}

bool RowReader::value(Value& value) {
  value.items.clear();
  value.is_array = false;
  if (takes(kNull)) return true;
  if (rest_.empty() || first() >> 5 != static_cast<unsigned>(Major::array))
    return scalar(value.items.emplace_back());
  std::uint64_t items = 0;
  if (!count(Major::array, items)) return false;
  value.is_array = true;
  for (; items > 0; --items)
    if (!scalar(value.items.emplace_back())) return false;
  return true;
}

bool read_reading(RowReader& in, RecordedReading& reading, std::uint64_t& items) {
  std::uint64_t kind = 0;
  if (!in.string(Major::text, reading.name) || !in.count(Major::whole, kind) ||
      !in.value(reading.value))
    return false;
  if ((kind & kTypeBits) > static_cast<std::uint64_t>(DataType::float64) ||
      kind > (kTypeBits | kScaled | kBad))
    return false;
  reading.type = static_cast<DataType>(kind & kTypeBits);
  reading.scaled = (kind & kScaled) != 0;
  reading.bad.reset();
  items -= kGoodItems;
  if ((kind & kBad) == 0) return true;
  std::uint64_t why = 0;
  if (items < kBadItems - kGoodItems || !in.count(Major::whole, why) ||
      why > static_cast<std::uint64_t>(BadReason::bad_value) || !in.integer(reading.bad_since_ms) ||
      !in.integer(reading.last_ms))
    return false;
  reading.bad = static_cast<BadReason>(why);
  items -= kBadItems - kGoodItems;
  return true;
}

}  // namespace

std::string encode_sample(const Telemetry& message, const DeviceConfig& device,
                          std::string_view boot, std::string_view meta) {
  std::size_t items = kHeadItems;
  for (const TagReading& reading : message.readings) items += reading.bad ? kBadItems : kGoodItems;
  RowWriter out(64 + 16 * message.readings.size());
  out.head(Major::array, items);
  out.integer(message.ts_ms);
  out.head(Major::whole, message.seq);
  out.string(Major::text, boot);
  out.string(Major::text, meta);
  message.span_ms ? out.real(*message.span_ms) : out.byte(kNull);
  out.head(Major::whole, (message.partial ? kPartial : 0) | (message.written ? kWritten : 0));
  for (const TagReading& reading : message.readings) {
    const TagConfig& tag = device.tags.at(reading.tag);
    out.string(Major::text, tag.name);
    out.head(Major::whole, static_cast<std::uint64_t>(tag.point.type) |
                               (tag.point.scaled() ? kScaled : 0) | (reading.bad ? kBad : 0));
    write_value(out, reading.value);
    if (!reading.bad) continue;
    out.head(Major::whole, static_cast<std::uint64_t>(*reading.bad));
    out.integer(reading.bad_since_ms);
    out.integer(reading.last_ms);
  }
  return out.take();
}

bool decode_sample(std::string_view row, SampleRecord& record) {
  RowReader in(row);
  std::uint64_t items = 0;
  std::uint64_t flags = 0;
  if (!in.count(Major::array, items) || items < kHeadItems || !in.integer(record.ts_ms) ||
      !in.count(Major::whole, record.seq) || !in.string(Major::text, record.boot) ||
      !in.string(Major::text, record.meta))
    return false;
  record.span_ms.reset();
  if (!in.takes(kNull) && !in.real(record.span_ms.emplace())) return false;
  if (!in.count(Major::whole, flags) || flags > (kPartial | kWritten)) return false;
  record.partial = (flags & kPartial) != 0;
  record.written = (flags & kWritten) != 0;
  std::size_t tags = 0;
  for (items -= kHeadItems; items > 0; ++tags) {
    if (record.readings.size() == tags) record.readings.emplace_back();
    if (items < kGoodItems || !read_reading(in, record.readings[tags], items)) return false;
  }
  record.readings.resize(tags);
  return in.at_end();
}

}  // namespace fxagent
