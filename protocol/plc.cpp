#include "protocol/plc.h"

#include <cstdio>

namespace fxagent {
namespace {

constexpr std::size_t kBcdWords = 3;
constexpr std::uint32_t kCentury = 2000;

/// Returns the number of two decimal digits in a byte; more than 99 if it has others.
std::uint32_t from_bcd(std::uint32_t byte) {
  const std::uint32_t tens = byte >> 4U & 0xFU;
  const std::uint32_t ones = byte & 0xFU;
  return tens > 9 || ones > 9 ? 0xFFFF : 10 * tens + ones;
}

}  // namespace

SpecialDevices special_devices_of_fx() {
  return {.battery_low = "M8005",
          .error = "D8004",
          .clock = SpecialDevices::Clock::words,
          .clock_copied = {},
          .clock_at = {"D8013", "D8014", "D8015", "D8016", "D8017", "D8018"}};
}

std::optional<std::string> clock_text(SpecialDevices::Clock form,
                                      std::span<const std::uint32_t> words) {
  std::array<std::uint32_t, 6> parts{};  // from the second to the year
  if (form == SpecialDevices::Clock::words && words.size() >= parts.size()) {
    for (std::size_t i = 0; i < parts.size(); ++i) parts[i] = words[i];
  } else if (form == SpecialDevices::Clock::bcd && words.size() >= kBcdWords) {
    for (std::size_t i = 0; i < parts.size(); ++i) {
      const std::uint32_t word = words[kBcdWords - 1 - i / 2];
      parts[i] = from_bcd(i % 2 == 0 ? word & 0xFFU : word >> 8U);
    }
  } else {
    return std::nullopt;
  }
  auto [second, minute, hour, day, month, year] = parts;
  // An FX shows two digits of the year, or four if it is told so.
  if (year < 100) year += kCentury;
  const bool is_date = month >= 1 && month <= 12 && day >= 1 && day <= 31 && year < 2100;
  if (!is_date || hour > 23 || minute > 59 || second > 59) return std::nullopt;
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%04u-%02u-%02u %02u:%02u:%02u", year, month, day, hour,
                minute, second);
  return std::string(text.data());
}

}  // namespace fxagent
