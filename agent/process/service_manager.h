// What systemd, where it has started us, is told by sd_notify: that the agent is ready, that it
// reads its config again or stops, that its threads go on, and in a line for people how it is.
// Without systemd nothing happens. Nobody waits for a reader that does not read: a second at the
// most for a word that the service manager waits for, and not at all for the others.
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <string_view>

namespace fxagent::service_manager {

/// Whether there is somebody to be told: NOTIFY_SOCKET is set.
bool is_there();

/// Field and uplink run; and, after tell_reloading(), that the new config is in force, or the old
/// one still is.
void tell_ready();
/// The config is being read again; tell_ready() ends that. With the time of now, which a unit of
/// Type=notify-reload asks for (systemd 253).
void tell_reloading();
/// A stop was asked for; how long it may take is the service manager's from now on.
void tell_stopping();
/// How often it wants tell_alive(), four times within WatchdogSec; nothing: there is no watchdog.
std::optional<std::chrono::nanoseconds> watchdog_interval();
void tell_alive();

/// Of a status so much is told.
inline constexpr std::size_t kMostStatusBytes = 1024;
/// One line for people, which `systemctl status` shows until the next: UTF-8. Control characters
/// become blanks, and what is behind kMostStatusBytes is left out.
void tell_status(std::string_view line);

}  // namespace fxagent::service_manager
