#include "protocol/scatter.h"

#include <cstdint>

namespace fxagent {

Write write_of(const Force& force) {
  return {{force.space, force.bit, 1}, {static_cast<std::uint8_t>(force.on ? 1 : 0)}, force.way};
}

std::optional<Scatter> scatter_of(const std::vector<Request>& requests) {
  if (requests.size() < 2) return std::nullopt;
  Scatter scatter;
  for (const Request& request : requests) {
    if (const auto* write = std::get_if<Write>(&request))
      scatter.parts.push_back(*write);
    else if (const auto* force = std::get_if<Force>(&request))
      scatter.parts.push_back(write_of(*force));
    else
      return std::nullopt;
  }
  return scatter;
}

}  // namespace fxagent
