// Parts of a 1E frame in both data codes, the model of the PLC and the reason of a refusal. Only
// for the files of this codec. Sources: FX3U-ENET-ADP User's Manual JY997D45801, 7.6.3 and 9.3;
// SH-080008, 18.2.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "protocol/codec.h"
#include "protocol/mc/body.h"
#include "protocol/mc/dialect.h"
#include "protocol/value/bytes.h"

namespace fxagent::mc::one_e {

/// First byte of a request. The answer has the same with 80h added.
enum class Command : std::uint8_t {
  read_bits = 0x00,
  read_words = 0x01,
  write_bits = 0x02,
  write_words = 0x03,
  random_bits = 0x04,
  random_words = 0x05,
  run = 0x13,
  stop = 0x14,
  model = 0x15,
  loop_back = 0x16,
};
constexpr std::uint8_t code(Command command) { return static_cast<std::uint8_t>(command); }

inline constexpr std::uint8_t kAnswer = 0x80;
/// Command and end code.
inline constexpr std::size_t kAnswerHead = 2;

/// Returns the binary form of `frame`, read as hex digits. Its words are still high byte first.
/// Drops a single last digit. nullopt: the frame is not hex digits.
std::optional<Bytes> from_ascii(ByteView frame);

/// End code that is followed by an abnormal code and 00.
inline constexpr int kWithReason = 0x5B;

/// Returns Reply::device_code: the end code with the abnormal code above it.
constexpr int device_code(int end_code, int abnormal_code) { return end_code | abnormal_code << 8; }

/// Returns "FX3U" for the first byte of an answer to 15; empty if it is not a model of the
/// catalogue.
std::string_view model_coded(int code);
/// Returns "57: too many points, or beyond the last device" for the end code of a refusal and,
/// after 5B, its abnormal code.
std::string refusal(int end_code, std::optional<int> abnormal_code);
/// Returns the meaning for a read or for any other request.
RefusalMeaning meaning_of(int device_code, bool reads);

}  // namespace fxagent::mc::one_e
