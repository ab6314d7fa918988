// Codes in 1E answers: the model of the PLC, and the reason of a refusal.
// Sources: FX3U-ENET-ADP User's Manual JY997D45801, 7.6.3 and 9.3; SH-080008, 18.2.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "protocol/codec.h"

namespace fxagent::mc::one_e {

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
