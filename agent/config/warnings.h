// What is allowed in a config file and is hardly meant: limits without effect, two devices of one
// station. Each goes to the reader as a warning, with its place.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <utility>

#include "agent/config/config.h"
#include "agent/config/reader.h"
#include "agent/config/templates.h"

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

/// Finds devices of one station, or unit, on one link.
class StationTable {
 public:
  /// Warns where a device before has the station of this one.
  void add(ConfigReader& reader, const DeviceEntry& entry, const DeviceConfig& device);

 private:
  /// By link and number: the entry of the first.
  std::map<std::pair<std::uint32_t, std::int64_t>, const ConfigNode*> first_;
};

}  // namespace fxagent
