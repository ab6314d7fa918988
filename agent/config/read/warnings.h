// Warns of settings that are allowed and probably a mistake: limits without effect, two devices
// with one station. Each warning goes to the reader, with its place.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <utility>

#include "agent/config/model.h"
#include "agent/config/read/devices/templates.h"
#include "agent/config/read/reader.h"

namespace fxagent {

/// Warns if `min` or `max` of the tag at `node` is beyond the range of its type, or if they leave
/// one value or none.
void warn_of_limits(ConfigReader& reader, const ConfigNode& node, const TagConfig& tag);

/// Warns if `max_silent_s` of the group at `node` is below its poll interval: every poll is
/// published then.
void warn_of_silence(ConfigReader& reader, const ConfigNode& node, const GroupConfig& group);

/// Warns of a speed or character format that the documents of the protocol or model do not list.
/// `config.links` was read from the array `links`; `lines` are their settings, with 0 baud if they
/// are unknown.
void warn_of_lines(ConfigReader& reader, const ConfigNode& links,
                   std::span<const SerialSettings> lines, const Config& config);

/// Finds devices with the same station or unit on one link.
class StationTable {
 public:
  /// Warns if an earlier device has the station or unit of this one.
  void add(ConfigReader& reader, const DeviceEntry& entry, const DeviceConfig& device);

 private:
  /// Entry of the first device, by link and number.
  std::map<std::pair<std::uint32_t, std::int64_t>, const ConfigNode*> first_;
};

}  // namespace fxagent
