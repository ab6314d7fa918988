#include "agent/handover/telemetry.h"

#include <array>
#include <cstddef>

namespace fxagent {

std::string_view to_string(BadReason reason) {
  constexpr auto kWords = std::to_array<std::string_view>(
      {"timeout", "nak", "bad_frame", "link_down", "unsupported", "bad_value"});
  static_assert(kWords.size() == static_cast<std::size_t>(BadReason::bad_value) + 1);
  return kWords[static_cast<std::size_t>(reason)];
}

std::string_view to_string(DeviceStatus::State state) {
  constexpr auto kWords =
      std::to_array<std::string_view>({"offline", "yielded", "degraded", "online"});
  static_assert(kWords.size() == static_cast<std::size_t>(DeviceStatus::State::online) + 1);
  return kWords[static_cast<std::size_t>(state)];
}

}  // namespace fxagent
