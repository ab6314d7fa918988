// Devices by their letters and their number on the wire, independent of the base in which a model
// writes the number: Y17 of an FX and YF of a Q are both Y 15. Used to compare whether two codecs
// mean the same device by a name.
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
  std::uint32_t bits = 1;    ///< bits of one device
  std::uint32_t first = 0;   ///< `first` and `last` are inclusive
  std::uint32_t last = 0;
  friend bool operator==(const DeviceNumbers&, const DeviceNumbers&) = default;
};

/// Returns the whole devices in `span`, at least one. `protocol` made the codec that read the span.
DeviceNumbers numbers_of(const ProtocolInfo& protocol, const Span& span);

/// Returns every device with these letters that the model of `codec` has; `protocol` made the
/// codec. Several runs if widths differ or numbers are missing. For an unknown model: those of the
/// widest.
std::vector<DeviceNumbers> devices_lettered(const ProtocolInfo& protocol, const Codec& codec,
                                            std::string_view letters);

}  // namespace fxagent
