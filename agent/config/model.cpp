#include "agent/config/model.h"

#include <tuple>

namespace fxagent {

const std::shared_ptr<const TagUnits>& no_units() {
  static const auto none = std::make_shared<const TagUnits>();
  return none;
}

bool operator==(const TagConfig& a, const TagConfig& b) {
  return a.name == b.name && a.point == b.point && a.group == b.group && a.writable == b.writable &&
         (a.units == b.units || *a.units == *b.units);
}

bool operator==(const DeviceConfig& a, const DeviceConfig& b) {
  const auto settings = [](const DeviceConfig& device) {
    return std::tie(device.name, device.link, device.protocol, device.timeout, device.retries,
                    device.gap, device.turnaround, device.echo, device.max_block_bytes,
                    device.enquire, device.groups, device.commands, device.tags);
  };
  const bool same_codec =
      a.options == b.options || (a.options && b.options && *a.options == *b.options);
  return settings(a) == settings(b) && same_codec;
}

}  // namespace fxagent
