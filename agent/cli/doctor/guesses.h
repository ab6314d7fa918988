// Settings under which a silent device may answer, likeliest first. Pure.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config/model.h"
#include "protocol/catalog.h"

namespace fxagent {

/// Wait for the answer to an unlikely guess.
inline constexpr std::chrono::milliseconds kGuessTimeout{250};

/// Returns the settings of a serial line to try for the protocol: `own` first, then its usual ones,
/// then the others at 9600, 19200 baud and so on. Each occurs once.
std::vector<LineDefaults> line_guesses(const ProtocolInfo& protocol, const LineDefaults& own);
/// Returns the serial link with another speed and shape of the characters.
LinkConfig with_line(LinkConfig link, const LineDefaults& line);
/// Returns the word of the config: "even".
std::string parity_word(Parity parity);

/// Returns the option that is the address of a device on its bus, "station" or "unit"; empty if the
/// protocol has neither.
std::string_view station_key(const ProtocolInfo& protocol);
/// Returns every address of a device, `own` first, then from the lowest. On Modbus TCP 255, 1
/// and 0 precede the others. Only `own` if the protocol has no addresses.
std::vector<std::int64_t> station_guesses(const ProtocolInfo& protocol, std::int64_t own);

}  // namespace fxagent
