// The `devices` of the config file: groups, tags and command rules, checked against their protocol.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "agent/config/config.h"
#include "agent/config/name_table.h"
#include "agent/config/reader.h"

namespace fxagent {

/// What a device needs to know of the links before it: one for each of the config's links.
struct LinkFacts {
  /// Which of the ways to a device it is.
  enum class Channel : std::uint8_t { none, serial, tcp, udp } channel = Channel::none;
  /// Of the first device on the link, whose protocol is that of all; null while there is none.
  const ProtocolInfo* protocol = nullptr;
  const ConfigNode* first_device = nullptr;
};

/// Reads `devices`, and the `templates` of the file, into `config.devices`, and notes in `facts`
/// which protocol each link speaks. What is wrong goes to the reader; a device with errors is left
/// half filled.
void read_devices(ConfigReader& reader, const ConfigNode& top, const ConfigNode& devices,
                  const NameTable& links, std::vector<LinkFacts>& facts, Config& config);

}  // namespace fxagent
