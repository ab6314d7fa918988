// What a PLC says by the codes of 1E answers: which model it is, and why it refuses.
// Sources: FX3U-ENET-ADP User's Manual JY997D45801, 7.6.3 and 9.3; SH-080008, 18.2.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "protocol/codec.h"

namespace fxagent::mc::one_e {

/// The end code behind which an abnormal code and 00 follow.
inline constexpr int kWithReason = 0x5B;

/// Of a Reply: the end code, and the abnormal code above it.
constexpr int device_code(int end_code, int abnormal_code) { return end_code | abnormal_code << 8; }

/// "FX3U" for the first byte of the answer to 15; empty where none of the catalogue answers so.
std::string_view model_coded(int code);
/// "57: too many points, or beyond the last device", for the end code of a refusal and, behind 5B,
/// its abnormal code.
std::string refusal(int end_code, std::optional<int> abnormal_code);
/// What it means for a read or for something else.
RefusalMeaning meaning_of(int device_code, bool reads);

}  // namespace fxagent::mc::one_e
