// The commands a test may send to the running simulator: faults, values, counters, list of deeds.
// One JSON object in, one out; README.md lists them.
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "tests/sim/station.h"

namespace fxsim {

using Stations = std::map<std::string, Station*, std::less<>>;

/// Carries out `request` at `now`. Errors come back as {"ok": false, "error": ...}. "quit" is
/// unknown here; the owner of the process handles it.
nlohmann::json obey(const nlohmann::json& request, const Stations& stations, TimePoint now);

/// Formats one line of the log file.
nlohmann::json log_line(const Exchange& exchange);

}  // namespace fxsim
