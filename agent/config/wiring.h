// Connects a device's config to protocol/checklist.h: how it is wired, and what to check when it is
// silent. Pure.
#pragma once

#include <string>

#include "agent/config/model.h"
#include "protocol/checklist.h"

namespace fxagent {

/// Returns how `device` is connected over `link`.
Wiring wiring_of(const LinkConfig& link, const DeviceConfig& device);
/// Returns checklist() with the settings of `device`; `codec` is its own, or that of the model that
/// the PLC named. Empty: the device has no protocol.
std::string checklist_of(const DeviceConfig& device, const Codec& codec, const Wiring& wiring,
                         Answers answers);

}  // namespace fxagent
