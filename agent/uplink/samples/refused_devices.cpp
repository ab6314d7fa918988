#include "agent/uplink/samples/refused_devices.h"

#include <algorithm>
#include <chrono>

#include "agent/log/log.h"

namespace fxagent {

void RefusedDevices::refused(const std::string& device, const DeliveryFailed& event,
                             SteadyTime now) {
  const int reason_code = event.reason_code;
  Pause& pause = pauses_[device];
  pause.reason_code = reason_code;
  if (pause.until > now) return;  // one of several refusals of messages in flight
  pause.since = now;
  pause.until = now + backoff_.after(pause.failures++);
  const std::string again =
      std::to_string(std::chrono::ceil<std::chrono::seconds>(pause.until - now).count());
  if (reason_code != 0)
    log::warn("samples_refused", {{"device", device},
                                  {"code", hex_code(reason_code)},
                                  {"reason", event.text},
                                  {"again_in_s", again}});
  else
    log::warn("samples_not_sent",
              {{"device", device}, {"reason", event.text}, {"again_in_s", again}});
}

void RefusedDevices::accepted(const std::string& device, SteadyTime since) {
  const auto found = pauses_.find(device);
  if (found != pauses_.end() && found->second.since < since) pauses_.erase(found);
}

bool RefusedDevices::may_send(const std::string& device, SteadyTime now) const {
  const auto found = pauses_.find(device);
  return found == pauses_.end() || found->second.until <= now;
}

std::optional<int> RefusedDevices::reason(const std::string& device) const {
  const auto found = pauses_.find(device);
  const bool refuses = found != pauses_.end() && found->second.reason_code != 0;
  return refuses ? std::optional(found->second.reason_code) : std::nullopt;
}

SteadyTime RefusedDevices::next_end(SteadyTime now,
                                    const std::function<bool(const std::string&)>& matters) const {
  SteadyTime next = SteadyTime::max();
  for (const auto& [device, pause] : pauses_)
    if (pause.until > now && matters(device)) next = std::min(next, pause.until);
  return next;
}

}  // namespace fxagent
