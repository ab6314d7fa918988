#include "protocol/fx/d8120.h"

#include <algorithm>
#include <array>
#include <variant>

#include "protocol/checklist.h"
#include "protocol/value/bytes.h"

namespace fxagent::fx {
namespace {

constexpr std::uint32_t kEightBits = 1U << 0U;
constexpr std::uint32_t kOddParity = 1U << 1U;
constexpr std::uint32_t kEvenParity = 3U << 1U;
constexpr std::uint32_t kTwoStopBits = 1U << 3U;
constexpr std::uint32_t kSpeedShift = 4;
constexpr std::uint32_t kSumCheck = 1U << 13U;
constexpr std::uint32_t kComputerLink = 1U << 14U;
constexpr std::uint32_t kFormat4 = 1U << 15U;
// Bits 4 to 7 are 3 for the first speed, 4 for the next, and so on.
constexpr std::array kSpeeds{300, 600, 1200, 2400, 4800, 9600, 19200, 38400};
constexpr std::uint32_t kFirstSpeed = 3;

}  // namespace

std::optional<std::uint16_t> d8120(const Options& options, const LineDefaults& line) {
  const auto speed = std::ranges::find(kSpeeds, line.baud);
  if (speed == kSpeeds.end()) return std::nullopt;
  std::uint32_t word = kComputerLink;
  word |= (kFirstSpeed + static_cast<std::uint32_t>(speed - kSpeeds.begin())) << kSpeedShift;
  if (line.data_bits == 8) word |= kEightBits;
  if (line.parity == Parity::odd) word |= kOddParity;
  if (line.parity == Parity::even) word |= kEvenParity;
  if (line.stop_bits == 2) word |= kTwoStopBits;
  if (const auto* sum_check = option<bool>(options, "sum_check"); !sum_check || *sum_check)
    word |= kSumCheck;
  if (const auto* format = option<std::int64_t>(options, "format"); format && *format == 4)
    word |= kFormat4;
  return static_cast<std::uint16_t>(word);
}

std::string d8120_for(const Options& options, const LineDefaults& line) {
  const auto word = d8120(options, line);
  if (!word) return "does D8120 have the speed, data bits and parity of this port";
  return "is D8120 H" + hex_text(*word, 4) + " (" + to_string(line) + ", RS-485)";
}

}  // namespace fxagent::fx
