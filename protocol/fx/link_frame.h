// Parts of computer-link frames, defined in computer_link.cpp and link_request.cpp. Only for the
// files of this codec.
#pragma once

#include <cstdint>
#include <string_view>

#include "protocol/fx/computer_link.h"

namespace fxagent::fx {

namespace link {

/// Control character, station and PLC number: a whole ACK, or the head of any other frame.
inline constexpr std::uint32_t kHeader = 5;
inline constexpr std::uint32_t kPc = 0xFF;  ///< PLC number of every FX

// Reasons in a NAK that decide whether the request is sent again.
inline constexpr int kSumMismatch = 0x02;
inline constexpr int kNoDevice = 0x06;

/// Returns the frame that acknowledges data: ACK, station, PLC number [CR LF].
Bytes acknowledge(const ComputerLink::Settings& settings);

}  // namespace link

/// Returns the text for the code of a NAK: "device does not exist or too many points".
std::string_view link_refusal(int code);
/// Returns the model for an answer to PC: "FX2N". Empty if it is not a model of the catalogue.
std::string_view link_model(int code);

}  // namespace fxagent::fx
