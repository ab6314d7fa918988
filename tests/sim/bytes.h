// Bytes on a line and their hexadecimal notation, as used in logs, faults and tests.
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

/// "02 30 03": two upper-case digits per byte, bytes separated by one blank.
std::string to_hex(ByteView bytes);

/// Parses the output of to_hex(); blanks are optional and lower case is accepted. Returns nullopt
/// for any other character or half a byte.
std::optional<Bytes> from_hex(std::string_view text);

/// Appends `byte` to `out` as two upper-case digits.
void append_hex(Bytes& out, std::uint8_t byte);
/// Parses up to eight upper-case hex digits. Returns nullopt for any other character, lower-case
/// digits included: clones read those as 0 or refuse them. No digits give 0.
std::optional<std::uint32_t> parse_upper_hex(std::string_view digits);

/// The low byte of the sum; the checksum of both FX protocols.
std::uint8_t sum_of(ByteView bytes);
/// Reads two bytes from `at`, high byte first. Precondition: both exist.
unsigned big_endian_at(ByteView bytes, std::size_t at);
/// The same bytes as text.
std::string_view as_text(ByteView bytes);
/// All words, separated by blanks.
std::string joined(std::span<const std::string_view> words);

}  // namespace fxsim
