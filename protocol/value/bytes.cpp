#include "protocol/value/bytes.h"

namespace fxagent {
namespace {

constexpr char kDigits[] = "0123456789ABCDEF";

bool is_separator(char c) {
  return c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == ',' || c == ':';
}

}  // namespace

std::string to_hex(ByteView bytes) {
  std::string text;
  text.reserve(bytes.size() * 3);
  for (const std::uint8_t byte : bytes) {
    if (!text.empty()) text += ' ';
    text += kDigits[byte >> 4];
    text += kDigits[byte & 0x0F];
  }
  return text;
}

Result<Bytes> from_hex(std::string_view text) {
  Bytes bytes;
  int high = -1;  // first digit of an incomplete pair
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    const bool prefix =
        high < 0 && c == '0' && i + 1 < text.size() && (text[i + 1] == 'x' || text[i + 1] == 'X');
    if (prefix) {
      ++i;
      continue;
    }
    if (is_separator(c)) {
      if (high >= 0) break;
      continue;
    }
    const int digit = hex_digit(static_cast<std::uint8_t>(c));
    if (digit < 0)
      return refuse("'" + std::string(1, c) + "' at position " + std::to_string(i + 1) +
                    " is not a hex digit");
    if (high < 0) {
      high = digit;
    } else {
      bytes.push_back(static_cast<std::uint8_t>(high * 16 + digit));
      high = -1;
    }
  }
  if (high >= 0)
    return refuse("digit '" + std::string(1, kDigits[high]) +
                  "' is left over: a byte needs two hex digits");
  return bytes;
}

std::uint8_t byte_sum(ByteView bytes) {
  std::uint32_t sum = 0;
  for (const std::uint8_t byte : bytes) sum += byte;
  return static_cast<std::uint8_t>(sum);
}

void append_hex(Bytes& out, std::uint64_t value, int digits) {
  for (int shift = (digits - 1) * 4; shift >= 0; shift -= 4)
    out.push_back(static_cast<std::uint8_t>(kDigits[(value >> shift) & 0x0F]));
}

std::string hex_text(std::uint64_t value, int digits) {
  Bytes out;
  append_hex(out, value, digits);
  return as_text(out);
}

std::string digits_of(std::uint32_t value, std::uint32_t base) {
  std::string text;
  do text.insert(text.begin(), kDigits[value % base]);
  while ((value /= base) != 0);
  return text;
}

}  // namespace fxagent
