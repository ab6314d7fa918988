// Devices by letters and number, as they go over the wire, whatever base a model writes the number
// in: Y17 of an FX and YF of a Q are both Y 15. What tells whether two codecs mean the same by a
// name.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "protocol/catalog.h"
#include "protocol/codec.h"
#include "protocol/point.h"

namespace fxagent {

/// A run of devices of one kind.
struct DeviceNumbers {
  std::string_view letters;  ///< "Y", "TN", "hr"
  std::uint32_t bits = 1;    ///< of one device
  std::uint32_t first = 0;   ///< both ends included
  std::uint32_t last = 0;
  friend bool operator==(const DeviceNumbers&, const DeviceNumbers&) = default;
};

/// The devices in `span`, which a codec of `protocol` has read: whole ones, at least one.
DeviceNumbers numbers_of(const ProtocolInfo& protocol, const Span& span);

/// Every device with these letters that the model of `codec`, made by `protocol`, has; several runs
/// where widths differ or numbers are left out. Of a model that is not known yet the widest.
std::vector<DeviceNumbers> devices_lettered(const ProtocolInfo& protocol, const Codec& codec,
                                            std::string_view letters);

}  // namespace fxagent
