#include "tests/sim/mc_message.h"

#include <algorithm>

#include "tests/sim/mc_device.h"

namespace fxsim {
namespace {

constexpr std::uint16_t kBits = 1;       // in a subcommand: points instead of words
constexpr std::uint16_t kLongCodes = 2;  // in a subcommand: iQ-R codes and numbers

int digit_of(std::uint8_t character) {
  if (character >= '0' && character <= '9') return character - '0';
  if (character >= 'A' && character <= 'F') return character - 'A' + 10;
  if (character >= 'a' && character <= 'f') return character - 'a' + 10;
  return 16;
}

/// Reads the device field of a request.
McAccess read_device(McReader& in, bool long_codes, Family family) {
  McAccess access;
  if (in.code() == McCode::binary) {
    access.number = in.number(long_codes ? 4 : 3);
    access.kind = mc_kind_of_code(in.number(long_codes ? 2 : 1), family);
    return access;
  }
  const auto letters = as_text(in.raw(long_codes ? 4 : 2));
  access.kind = mc_kind_of_letters(letters, long_codes, family);
  // For an unknown device only the length of the number matters.
  const auto digits = long_codes ? 8U : 6U;
  if (access.kind) {
    access.number = in.digits(digits, mc_base_of(*access.kind));
  } else {
    in.raw(digits);
  }
  return access;
}

class Parser final {
 public:
  Parser(ByteView body, McCode code, Family family) : in_(body, code), family_(family) {}

  McRequest read(std::size_t size) {
    request_.command = static_cast<std::uint16_t>(in_.number(2));
    request_.subcommand = static_cast<std::uint16_t>(in_.number(2));
    const bool known = !in_.cut_off() && !in_.unreadable() && read_data();
    if (in_.unreadable()) {
      request_.shape = McRequest::Shape::unreadable;
    } else if (in_.cut_off()) {
      request_.shape = McRequest::Shape::cut_off;
    } else if (!known) {
      request_.shape = McRequest::Shape::unknown;
    } else if (in_.left() > 0) {
      request_.shape = McRequest::Shape::excess;
    }
    request_.used = size - in_.left();
    return std::move(request_);
  }

 private:
  bool bits() const { return (request_.subcommand & kBits) != 0; }
  bool long_codes() const { return (request_.subcommand & kLongCodes) != 0; }
  bool broken() const { return in_.cut_off() || in_.unreadable(); }
  McAccess device() { return read_device(in_, long_codes(), family_); }

  /// Returns false if the command or its subcommand is unknown.
  bool read_data() {
    const auto most = request_.subcommand;
    switch (request_.command) {
      case 0x0401:
        return most <= (kBits | kLongCodes) && read_row(false);
      case 0x1401:
        return most <= (kBits | kLongCodes) && read_row(true);
      case 0x0403:
        return (most & ~kLongCodes) == 0 && read_random(false);
      case 0x1402:
        return most <= (kBits | kLongCodes) && (bits() ? read_random_bits() : read_random(true));
      case 0x0406:
        return (most & ~kLongCodes) == 0 && read_blocks(false);
      case 0x1406:
        return (most & ~kLongCodes) == 0 && read_blocks(true);
      default:
        return most == 0 && read_order();
    }
  }

  bool read_order() {
    switch (request_.command) {
      case 0x0101:
      case 0x1617:
        return true;
      case 0x0619:
      case 0x1630:
      case 0x1631: {
        const auto text = in_.raw(in_.number(2));
        request_.text.assign(text.begin(), text.end());
        return true;
      }
      case 0x1001:
        request_.mode = in_.number(2);
        request_.clear_mode = in_.number(1);
        in_.number(1);
        return true;
      case 0x1002:
      case 0x1003:
      case 0x1005:
      case 0x1006:
        request_.mode = in_.number(2);
        return true;
      default:
        return false;
    }
  }

  void read_words(McAccess& access, unsigned count) {
    const auto size = std::size_t{count} * (in_.code() == McCode::binary ? 2U : 4U);
    if (size > in_.left()) {
      in_.raw(size);  // records that data is missing
      return;
    }
    for (unsigned i = 0; i < count; ++i) access.values.push_back(in_.number(2));
  }

  bool read_row(bool writes) {
    auto access = device();
    access.points = in_.number(2);
    if (in_.cut_off()) return true;
    if (writes && bits()) {
      access.values = in_.points(access.points);
    } else if (writes) {
      read_words(access, access.points);
    }
    request_.accesses.push_back(std::move(access));
    return true;
  }

  bool read_random(bool writes) {
    request_.words = in_.number(1);
    request_.doubles = in_.number(1);
    for (unsigned i = 0; i < request_.words + request_.doubles && !broken(); ++i) {
      auto access = device();
      access.is_double = i >= request_.words;
      if (writes) access.values = {in_.number(access.is_double ? 4 : 2)};
      if (in_.cut_off()) return true;
      request_.accesses.push_back(std::move(access));
    }
    return true;
  }

  bool read_random_bits() {
    request_.words = in_.number(1);
    for (unsigned i = 0; i < request_.words && !broken(); ++i) {
      auto access = device();
      access.values = {in_.number(long_codes() ? 2 : 1)};
      if (in_.cut_off()) return true;
      request_.accesses.push_back(std::move(access));
    }
    return true;
  }

  bool read_blocks(bool writes) {
    request_.words = in_.number(1);
    request_.doubles = in_.number(1);
    for (unsigned i = 0; i < request_.words + request_.doubles && !broken(); ++i) {
      auto access = device();
      access.is_bit_block = i >= request_.words;
      access.points = in_.number(2);
      if (in_.cut_off()) return true;
      if (writes) read_words(access, access.points);
      request_.accesses.push_back(std::move(access));
    }
    return true;
  }

  McReader in_;
  Family family_;
  McRequest request_;
};

}  // namespace

std::uint32_t McReader::number(unsigned size) {
  if (code_ == McCode::ascii) return numeral(size * 2, 16, false);
  const auto bytes = raw(size);
  std::uint32_t value = 0;
  for (std::size_t i = bytes.size(); i > 0; --i) value = value << 8U | bytes[i - 1];
  return value;
}

std::uint32_t McReader::digits(unsigned count, unsigned base) { return numeral(count, base, true); }

std::uint32_t McReader::numeral(unsigned count, unsigned base, bool blanks) {
  std::uint32_t value = 0;
  for (const auto character : raw(count)) {
    if (character == ' ' && blanks) continue;
    blanks = false;  // only leading blanks
    const auto digit = static_cast<unsigned>(digit_of(character));
    if (digit >= base) {
      unreadable_ = true;
      return 0;
    }
    value = value * base + digit;
  }
  return value;
}

ByteView McReader::raw(std::size_t count) {
  if (count > rest_.size()) {
    cut_off_ = true;
    rest_ = {};
    return {};
  }
  const auto found = rest_.first(count);
  rest_ = rest_.subspan(count);
  return found;
}

std::vector<std::uint32_t> McReader::points(unsigned count) {
  std::vector<std::uint32_t> values;
  if (code_ == McCode::ascii) {
    for (const auto character : raw(count)) {
      const auto digit = digit_of(character);
      unreadable_ = unreadable_ || digit > 15;
      values.push_back(static_cast<std::uint32_t>(digit));
    }
    return values;
  }
  for (const auto byte : raw((std::size_t{count} + 1) / 2)) {
    values.push_back(byte >> 4U);
    if (values.size() < count) values.push_back(byte & 0x0FU);
  }
  return values;
}

void append_mc(Bytes& out, McCode code, std::uint32_t value, unsigned size) {
  for (unsigned i = 0; i < size; ++i) {
    const auto shift = 8 * (code == McCode::binary ? i : size - 1 - i);
    const auto byte = static_cast<std::uint8_t>(value >> shift);
    if (code == McCode::binary) {
      out.push_back(byte);
    } else {
      append_hex(out, byte);
    }
  }
}

void append_mc_points(Bytes& out, McCode code, const std::vector<std::uint32_t>& points) {
  if (code == McCode::ascii) {
    for (const auto point : points) out.push_back(point != 0 ? '1' : '0');
    return;
  }
  for (std::size_t i = 0; i < points.size(); i += 2) {
    const bool second = i + 1 < points.size() && points[i + 1] != 0;
    out.push_back(static_cast<std::uint8_t>((points[i] != 0 ? 0x10U : 0U) | (second ? 1U : 0U)));
  }
}

McRequest read_mc_request(ByteView body, McCode code, Family family) {
  return Parser(body, code, family).read(body.size());
}

}  // namespace fxsim
