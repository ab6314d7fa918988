// Reads `links` of the config file: serial ports, TCP and UDP hosts, and the settings of their
// lines. Joins each device to its link.
#pragma once

#include <string_view>
#include <vector>

#include "agent/config/model.h"
#include "agent/config/read/reader.h"

namespace fxagent {

class DeviceEntry;

/// State of one link while the devices are read. There is one for each link of the config.
struct LinkFacts {
  std::string_view channel;  ///< "serial", "tcp" or "udp"; empty if the link has an error
  /// Node with the keys of the serial line; nullptr if the link has none.
  const ConfigNode* line = nullptr;
  /// Protocol of the first device on the link, which all others must have too; nullptr until then.
  const ProtocolInfo* protocol = nullptr;
  const ConfigNode* first_device = nullptr;
};

/// The links while the file is read, in its order.
struct Links {
  NameTable names;
  std::vector<LinkFacts> facts;
};

/// Reads the links at `array` into `config.links`. Reports faults to `reader`.
Links read_links(ConfigReader& reader, const ConfigNode& array, Config& config);

/// Sets `device.link` to the link that the entry names. Checks that the link's channel and its
/// other devices allow the protocol, and records it in `links.facts`. Reports faults to `reader`.
void join_link(ConfigReader& reader, const DeviceEntry& entry, Links& links, DeviceConfig& device);

/// Reads the settings of the serial lines, of which the protocol supplies missing ones. Call it
/// when the devices are known. Warns of links without devices and of unusual line settings.
void finish_links(ConfigReader& reader, const ConfigNode& array, const Links& links,
                  Config& config);

/// Sets the silences that guard against late replies: the time that each link listens before its
/// first request, and the gap before requests on UDP.
void set_silences(Config& config);

}  // namespace fxagent
