// What systemd, where it has started us, is told by sd_notify: that the agent is ready, that it
// stops, and that its threads go on. Without systemd nothing happens.
#pragma once

#include <chrono>
#include <optional>

namespace fxagent::service_manager {

/// Field and uplink run.
void tell_ready();
/// A stop was asked for; how long it may take is the service manager's from now on.
void tell_stopping();
/// How often it wants tell_alive(), four times within WatchdogSec; nothing: there is no watchdog.
std::optional<std::chrono::nanoseconds> watchdog_interval();
void tell_alive();

}  // namespace fxagent::service_manager
