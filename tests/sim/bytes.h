// Bytes of a line and their hexadecimal spelling, as logs, faults and tests write them.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace fxsim {

using Bytes = std::vector<std::uint8_t>;
using ByteView = std::span<const std::uint8_t>;
using Clock = std::chrono::steady_clock;
using TimePoint = Clock::time_point;

/// "02 30 03": two upper-case digits a byte, one blank between bytes.
std::string to_hex(ByteView bytes);

/// Reads what to_hex() writes; blanks are optional and lower case is fine. Nothing on any other
/// character or on half a byte.
std::optional<Bytes> from_hex(std::string_view text);

/// Two upper-case digits at the end of `out`.
void append_hex(Bytes& out, std::uint8_t byte);
/// The number that upper-case hex digits write, at most eight of them. Nothing on any other
/// character: clones take a lower-case digit for 0 or refuse it. No digits are 0.
std::optional<std::uint32_t> parse_upper_hex(std::string_view digits);

/// The low byte of the sum, the check of both FX protocols.
std::uint8_t sum_of(ByteView bytes);
/// The two bytes from `at` on, the high one first. Precondition: they are there.
unsigned big_endian_at(ByteView bytes, std::size_t at);
/// The same bytes as text.
std::string_view as_text(ByteView bytes);

}  // namespace fxsim
