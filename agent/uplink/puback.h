// Reason codes of a PUBACK: MQTT 5, section 3.4.2.1.
#pragma once

#include <cstdint>
#include <string>

#include "protocol/value/bytes.h"

namespace fxagent {

/// Failures that a repetition cannot cure.
inline constexpr int kTopicNameInvalid = 0x90;
inline constexpr int kPacketTooLarge = 0x95;
inline constexpr int kPayloadFormatInvalid = 0x99;

/// True if the broker would refuse the message again at any later time.
inline bool is_final(int reason_code) {
  return reason_code == kTopicNameInvalid || reason_code == kPacketTooLarge ||
         reason_code == kPayloadFormatInvalid;
}

/// Returns the code as the standard writes it; "none" if the failure has no code, as on 3.1.1.
inline std::string hex_code(int reason_code) {
  if (reason_code == 0) return "none";
  Bytes digits;
  append_hex(digits, static_cast<std::uint32_t>(reason_code), 2);
  return "0x" + std::string(digits.begin(), digits.end());
}

}  // namespace fxagent
