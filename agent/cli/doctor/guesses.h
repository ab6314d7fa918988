// Settings under which a silent device may answer, likeliest first. Pure.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "protocol/catalog.h"

namespace fxagent {

/// Returns the settings of a serial line to try for the protocol: `own` first, then its usual ones,
/// then the others at 9600, 19200 baud and so on. Each occurs once.
std::vector<LineDefaults> line_guesses(const ProtocolInfo& protocol, const LineDefaults& own);

/// Returns the option that is the address of a device on its bus, "station" or "unit"; empty if the
/// protocol has neither.
std::string_view station_key(const ProtocolInfo& protocol);
/// Returns every address of a device, `own` first, then from the lowest. On
/// Modbus TCP 255, 1 and 0 precede the others.
std::vector<std::int64_t> station_guesses(const ProtocolInfo& protocol, std::int64_t own);

}  // namespace fxagent
