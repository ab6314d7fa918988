#include "agent/handover/telemetry.h"

namespace fxagent {

std::string_view to_string(BadReason reason) {
  switch (reason) {
    case BadReason::timeout:
      return "timeout";
    case BadReason::nak:
      return "nak";
    case BadReason::bad_frame:
      return "bad_frame";
    case BadReason::link_down:
      return "link_down";
    case BadReason::unsupported:
      return "unsupported";
    case BadReason::bad_value:
      return "bad_value";
  }
  return "bad_value";
}

std::string_view to_string(DeviceStatus::State state) {
  switch (state) {
    case DeviceStatus::State::offline:
      return "offline";
    case DeviceStatus::State::yielded:
      return "yielded";
    case DeviceStatus::State::degraded:
      return "degraded";
    case DeviceStatus::State::online:
      return "online";
  }
  return "offline";
}

}  // namespace fxagent
