// The newest state of each device, as the field has reported it. Uplink thread; the states are
// immutable, and any thread may read on in one that it holds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "agent/config/config_difference.h"
#include "agent/handover/telemetry.h"

namespace fxagent {

class DeviceStates final {
 public:
  explicit DeviceStates(std::size_t devices) : states_(devices) {}

  void set(DeviceStatus status) {
    const std::uint32_t device = status.device;
    states_.at(device) = std::make_shared<const DeviceStatus>(std::move(status));
  }
  /// Adapts to a config change: forgets the states of devices that end.
  void change(const ConfigChange& change) {
    for (const std::uint32_t device : change.devices_end) states_.at(device).reset();
    states_.resize(change.config.devices.size());
  }
  /// Indexed by device; null if none was set.
  const std::vector<std::shared_ptr<const DeviceStatus>>& all() const { return states_; }

 private:
  /// Shared with each status made from them.
  std::vector<std::shared_ptr<const DeviceStatus>> states_;
};

}  // namespace fxagent
