#include "protocol/scatter.h"

#include <cstdint>
#include <utility>

namespace fxagent {

Write write_of(const Force& force) {
  return {{force.space, force.bit, 1}, {static_cast<std::uint8_t>(force.on ? 1 : 0)}, force.way};
}

std::optional<Request> Codec::combine(const std::vector<Request>& requests) const {
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
  if (!encode(scatter, 0)) return std::nullopt;
  return Request(std::move(scatter));
}

}  // namespace fxagent
