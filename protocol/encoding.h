// Numbers and control characters on the wire, and steps of Codec::encode() that several protocols
// share. The .cpp also has Codec::combine() and shorter_read().
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/codec.h"

namespace fxagent {

// Control characters (ASCII) that begin, end and acknowledge frames of serial lines.
inline constexpr std::uint8_t kStx = 0x02;
inline constexpr std::uint8_t kEtx = 0x03;
inline constexpr std::uint8_t kEot = 0x04;
inline constexpr std::uint8_t kEnq = 0x05;
inline constexpr std::uint8_t kAck = 0x06;
inline constexpr std::uint8_t kLf = 0x0A;
inline constexpr std::uint8_t kCl = 0x0C;
inline constexpr std::uint8_t kCr = 0x0D;
inline constexpr std::uint8_t kDle = 0x10;  ///< around 4C frames of format 5; doubled inside
inline constexpr std::uint8_t kNak = 0x15;

/// Form of the numbers on the wire: hex digits, or bytes with the high or the low one first.
enum class NumberForm : std::uint8_t { digits, high_first, low_first };

/// Returns the number in all of `wire`, at most 8 digits or 4 bytes. nullopt: not digits.
std::optional<std::uint32_t> number_in(NumberForm form, ByteView wire);
/// True if all of `wire` are hex digits.
bool is_hex(ByteView wire);
/// Returns the bytes that pairs of hex digits spell, without a single last digit. Error: bad_frame
/// quotes the first pair that is not hex.
Result<Bytes> bytes_in(ByteView digits);
/// Returns why the two characters are not the hex digits of byte_sum(bytes); empty if they are.
std::string why_wrong_sum(ByteView given, ByteView bytes);

/// Returns why a frame cannot carry the write: the image is not that of its bits, or there are more
/// than `most`. Empty if it can.
std::string why_wrong_image(const Write& write, std::uint32_t most = 0xFFFFFFFF);
/// Returns the force as a write of its single bit, by the same way.
Write write_of(const Force& force);

/// Returns the one of `ways` that has this number and reaches `span`. `name` returns the name of
/// its device, and is called for an error only. Errors: bad_request if it cannot read exactly this
/// span; unsupported if there is none: "D0: 16 bits cannot be `how` on this model".
Result<ReadWay> way_for(const std::vector<ReadWay>& ways, std::uint8_t number, const Span& span,
                        const std::function<std::string()>& name, std::string_view how);

}  // namespace fxagent
