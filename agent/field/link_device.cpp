#include "agent/field/link_device.h"

#include <algorithm>

#include "agent/log/log.h"

namespace fxagent {
namespace {

// Limits the log of a device that gives ever new reasons.
constexpr std::size_t kMostLogged = 8;

}  // namespace

void LinkDevice::log_refusal_once(const std::string& reason) {
  if (logged_refusals.size() >= kMostLogged) return;
  if (std::ranges::find(logged_refusals, reason) != logged_refusals.end()) return;
  logged_refusals.push_back(reason);
  log::warn("device",
            {{"device", config.name}, {"refused", "what it is asked"}, {"reason", reason}});
}

}  // namespace fxagent
