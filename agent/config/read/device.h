// Reads `devices` of the config file: groups, tags and command rules, checked against the protocol.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "agent/config/config.h"
#include "agent/config/read/name_table.h"
#include "agent/config/read/reader.h"

namespace fxagent {

/// State of one link while the devices are read. There is one for each link of the config.
struct LinkFacts {
  /// Kind of the link's channel; none if the link has an error.
  enum class Channel : std::uint8_t { none, serial, tcp, udp } channel = Channel::none;
  /// Protocol of the first device on the link, which all others must have too; nullptr until then.
  const ProtocolInfo* protocol = nullptr;
  const ConfigNode* first_device = nullptr;
};

/// Reads `devices`, with the `templates` of the file, into `config.devices`. Records the protocol
/// of each link in `facts`. Reports faults to `reader`. A device with errors stays partly filled.
void read_devices(ConfigReader& reader, const ConfigNode& top, const ConfigNode& devices,
                  const NameTable& links, std::vector<LinkFacts>& facts, Config& config);

}  // namespace fxagent
