#include "protocol/plc.h"

#include <array>

namespace fxagent {
namespace {

using Clock = SpecialDevices::Clock;

constexpr std::uint32_t kNoNumber = 0xFFFF;

/// Returns the number of two decimal digits in a byte; kNoNumber if it has others.
std::uint32_t from_bcd(std::uint8_t byte) {
  const std::uint32_t tens = byte >> 4U;
  const std::uint32_t ones = byte & 0xFU;
  return tens > 9 || ones > 9 ? kNoNumber : 10 * tens + ones;
}

std::string two_digits(std::uint32_t number) {
  return (number < 10 ? "0" : "") + std::to_string(number);
}

}  // namespace

SpecialDevices special_devices_of_fx() {
  return {.battery_low = "M8005",
          .has_error = "M8004",
          .error = "D8004",
          .clock = Clock::from_second,
          .clock_copied = {},
          .clock_at = "D8013"};
}

std::uint32_t clock_words(Clock form) {
  return form == Clock::none ? 0 : form == Clock::bcd ? 3 : 6;
}

std::optional<std::string> clock_text(Clock form, ByteView image) {
  if (form == Clock::none || image.size() < 2 * clock_words(form)) return std::nullopt;
  std::array<std::uint32_t, 6> parts{};  // from the year to the second
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const std::size_t word = 2 * (form == Clock::from_second ? parts.size() - 1 - i : i);
    // The year is the high byte of the first word, the month its low byte.
    parts[i] = form == Clock::bcd ? from_bcd(image[i % 2 == 0 ? i + 1 : i - 1])
                                  : image[word] | std::uint32_t{image[word + 1]} << 8U;
  }
  auto [year, month, day, hour, minute, second] = parts;
  if (year < 100) year += year < 80 ? 2000 : 1900;
  const bool is_date = year >= 1980 && year < 2100 && month >= 1 && month <= 12 && day >= 1 &&
                       day <= 31 && hour <= 23 && minute <= 59 && second <= 59;
  if (!is_date) return std::nullopt;
  return std::to_string(year) + "-" + two_digits(month) + "-" + two_digits(day) + " " +
         two_digits(hour) + ":" + two_digits(minute) + ":" + two_digits(second);
}

}  // namespace fxagent
