// Notifies systemd by sd_notify if it started the agent. Reports that the agent is ready, reloads
// or stops; feeds the watchdog; sends a status line for people. Does nothing without systemd. If
// the socket is full because its reader is stuck, a message that the service manager waits for
// blocks for at most 1 s; the others do not block.
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <string_view>

namespace fxagent::service_manager {

/// True if there is a service manager: NOTIFY_SOCKET is set.
bool is_there();

/// Field and uplink are running. After notify_reloading(): the new or the old config is in force.
void notify_ready();
/// The config is being read again, until notify_ready(). Sends the current time, which a unit of
/// Type=notify-reload needs (systemd 253).
void notify_reloading();
/// A stop was requested; the service manager's time limit applies after this call.
void notify_stopping();
/// Returns the interval for notify_alive(), a quarter of WatchdogSec; nullopt: no watchdog is set.
std::optional<std::chrono::nanoseconds> watchdog_interval();
void notify_alive();

/// Most bytes of a status that are sent.
inline constexpr std::size_t kMostStatusBytes = 1024;
/// Sends one line of UTF-8 for people, which `systemctl status` shows until the next. Control
/// characters become blanks; bytes beyond kMostStatusBytes are left out.
void notify_status(std::string_view line);

}  // namespace fxagent::service_manager
