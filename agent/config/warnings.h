// What is allowed in a config file and is hardly meant: limits without effect, two devices of one
// station. Each goes to the reader as a warning, with its place.
#pragma once

#include <span>

#include "agent/config/config.h"
#include "agent/config/reader.h"

namespace fxagent {

/// `min` and `max` of the tag at `node`: a limit beyond what its type can hold, and limits that
/// leave one value or none.
void warn_of_limits(ConfigReader& reader, const ConfigNode& node, const TagConfig& tag);

/// A `max_silent_s` below the poll interval of the group at `node`: then every poll is published.
void warn_of_silence(ConfigReader& reader, const ConfigNode& node, const GroupConfig& group);

/// Speeds and characters that neither the documents of the protocol on a line know nor those of the
/// models. `links` is the array that `config.links` was read from, `lines` are their settings; with
/// 0 baud: not known.
void warn_of_lines(ConfigReader& reader, const ConfigNode& links,
                   std::span<const SerialSettings> lines, const Config& config);

/// Devices of one station, or unit, on one link. `devices` is the array that `config.devices` was
/// read from.
void warn_of_equal_stations(ConfigReader& reader, const ConfigNode& devices, const Config& config);

}  // namespace fxagent
