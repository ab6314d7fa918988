// The link of a device: finds it, and checks that its channel and its other devices allow the
// protocol.
#pragma once

#include <vector>

#include "agent/config/read/devices/templates.h"
#include "agent/config/read/links.h"
#include "agent/config/read/reader.h"

namespace fxagent {

/// Sets `device.link` to the link that the entry names. Records the protocol of the link in
/// `facts`. Reports faults to `reader`.
void join_link(ConfigReader& reader, const DeviceEntry& entry, const NameTable& links,
               std::vector<LinkFacts>& facts, DeviceConfig& device);

}  // namespace fxagent
