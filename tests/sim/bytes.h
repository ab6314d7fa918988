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

}  // namespace fxsim
