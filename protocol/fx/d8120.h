// Word D8120 of an FX: the line and format of its computer link.
// Source: FX Communication User's Manual JY992D69901, chapters 7 and 8; 38400 baud from
// JY997D16901.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "protocol/catalog.h"

namespace fxagent::fx {

/// Returns D8120 for RS-485; nullopt: no FX has this line.
std::optional<std::uint16_t> d8120(const Options& options, const LineDefaults& line);
/// Returns a question for a checklist: "is D8120 H6086 (9600 baud 7E1, RS-485)".
std::string d8120_for(const Options& options, const LineDefaults& line);

}  // namespace fxagent::fx
