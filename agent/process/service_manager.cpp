#include "agent/process/service_manager.h"

#include <systemd/sd-daemon.h>

#include <cstdint>

namespace fxagent::service_manager {

// What sd_notify() says is nobody's: a service manager that cannot be told waits for itself.
void tell_ready() { sd_notify(0, "READY=1"); }
void tell_stopping() { sd_notify(0, "STOPPING=1"); }
void tell_alive() { sd_notify(0, "WATCHDOG=1"); }

std::optional<std::chrono::nanoseconds> watchdog_interval() {
  std::uint64_t within_us = 0;
  if (sd_watchdog_enabled(0, &within_us) <= 0) return std::nullopt;
  return std::chrono::microseconds(within_us) / 4;
}

}  // namespace fxagent::service_manager
