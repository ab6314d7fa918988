// Bytes on a wire, and their hex spelling.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/value/result.h"

namespace fxagent {

using Bytes = std::vector<std::uint8_t>;
using ByteView = std::span<const std::uint8_t>;

inline ByteView as_bytes(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

/// Returns "02 30 03": upper case, one blank between bytes.
std::string to_hex(ByteView bytes);

/// Parses "02 30 03", "023003" or "0x02,0x30". Skips blanks, commas, colons and 0x prefixes. Error:
/// bad_request names the first character that is not hex, or a digit left over.
Result<Bytes> from_hex(std::string_view text);

/// Returns the value of one ASCII hex digit of either case, or -1 for any other character.
constexpr int hex_digit(std::uint8_t c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  return -1;
}

/// Returns the byte that the first two characters of `digits` spell in hex, or -1 if they are not
/// hex digits. `digits` must hold two characters.
constexpr int hex_byte(ByteView digits) {
  const int high = hex_digit(digits[0]);
  const int low = hex_digit(digits[1]);
  return high < 0 || low < 0 ? -1 : high * 16 + low;
}

/// Returns the low 8 bits of the sum of all bytes.
std::uint8_t byte_sum(ByteView bytes);

/// Appends `digits` upper-case hex digits of `value`, most significant first.
void append_hex(Bytes& out, std::uint64_t value, int digits);

/// Returns `digits` upper-case hex digits of `value`.
std::string hex_text(std::uint64_t value, int digits);

/// Returns `value` in base 2 to 16, in upper case and without leading zeros.
std::string digits_of(std::uint32_t value, std::uint32_t base);

inline std::string as_text(ByteView characters) { return {characters.begin(), characters.end()}; }

}  // namespace fxagent
