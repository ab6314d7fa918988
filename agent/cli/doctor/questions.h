// The questions that `doctor` and `scan` ask, and the lines on which they ask them.
#pragma once

#include <chrono>
#include <optional>
#include <string>

#include "agent/config/model.h"
#include "agent/field/line_probe.h"
#include "protocol/codec.h"

namespace fxagent {

/// Wait for the answer to an unlikely guess.
inline constexpr std::chrono::milliseconds kGuessTimeout{250};

/// Returns the word of the config for it.
std::string word_of(Parity parity);
/// Returns the serial link with another speed and shape of the characters.
LinkConfig with_line(LinkConfig link, const LineDefaults& line);

/// Returns the first question to a device; nullopt: none would be answered.
std::optional<Request> first_question(const Codec& codec);
/// Asks the first question, which there must be, after putting the receiver of the device into a
/// known state.
ProbeAnswer greet(LineProbe& probe, const Codec& codec, std::chrono::milliseconds timeout);
/// True if the device itself has answered, even with a refusal.
bool is_there(const ProbeAnswer& answer, const Codec& codec);

}  // namespace fxagent
