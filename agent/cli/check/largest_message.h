// Sizes of the largest messages that a config can make, for brokers with a limit. Pure.
#pragma once

#include <cstddef>

#include "agent/config/model.h"
#include "agent/uplink/payload/payload.h"

namespace fxagent {

/// Returns the bytes of the largest sample of a group on its history topic, where it is longest. A
/// sample is largest while its tags are bad, since it then has last values and times as well.
/// `group` is an index in `device.groups`.
std::size_t largest_history(SamplePayload& payload, const DeviceConfig& device, std::size_t group);

/// Returns the bytes of health after years of operation.
std::size_t largest_health(const Config& config);

}  // namespace fxagent
