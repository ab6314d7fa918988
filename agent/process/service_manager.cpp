#include "agent/process/service_manager.h"

#include "agent/file_handle.h"
#include "agent/process/this_process.h"
#include "agent/text/text.h"

#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace fxagent::service_manager {
namespace {

/// Time to wait for room in a socket that is full because it is not read.
enum class Patience : std::uint8_t {
  none,   ///< comes again, or is only for people
  short_  ///< the service manager waits for it
};
constexpr timeval kShort{1, 0};

/// sd_notify(3): sends one datagram to the socket named in NOTIFY_SOCKET; @ begins an abstract
/// name. Ignores errors: a service manager that gets no message runs into its own time-out.
void tell(std::string_view state, Patience patience) {
  const std::string path = process_environment("NOTIFY_SOCKET").value_or("");
  sockaddr_un address{};
  // At most 107 bytes, as in systemd's own library: one of the 108 is for the end.
  const bool is_name = path.size() > 1 && (path.front() == '/' || path.front() == '@');
  if (!is_name || path.size() >= sizeof address.sun_path) return;
  address.sun_family = AF_UNIX;
  std::ranges::copy(path, address.sun_path);
  if (path.front() == '@') address.sun_path[0] = '\0';
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + path.size());
  const FileHandle out(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (out < 0) return;
  if (patience == Patience::short_)
    ::setsockopt(out, SOL_SOCKET, SO_SNDTIMEO, &kShort, sizeof kShort);
  ::sendto(out, state.data(), state.size(),
           MSG_NOSIGNAL | (patience == Patience::none ? MSG_DONTWAIT : 0),
           reinterpret_cast<const sockaddr*>(&address), size);
}

}  // namespace

bool is_there() { return !process_environment("NOTIFY_SOCKET").value_or("").empty(); }

void notify_ready() { tell("READY=1", Patience::short_); }

void notify_reloading() {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();  // CLOCK_MONOTONIC
  const auto now_us = std::chrono::duration_cast<std::chrono::microseconds>(now).count();
  tell("RELOADING=1\nMONOTONIC_USEC=" + std::to_string(now_us), Patience::short_);
}

void notify_stopping() { tell("STOPPING=1", Patience::short_); }
void notify_alive() { tell("WATCHDOG=1", Patience::none); }

void notify_status(std::string_view line) {
  // Do not cut a character in two: systemd ignores text that is not UTF-8.
  std::string text(beginning(line, kMostStatusBytes));
  // A second line would be another message.
  std::ranges::replace_if(text, is_control, ' ');
  tell("STATUS=" + text, Patience::none);
}

// sd_watchdog_enabled(3).
std::optional<std::chrono::nanoseconds> watchdog_interval() {
  constexpr std::uint64_t longest_us = std::chrono::microseconds(std::chrono::years(100)).count();
  const auto within_us =
      number_from<std::uint64_t>(process_environment("WATCHDOG_USEC").value_or(""));
  const std::string pid = process_environment("WATCHDOG_PID").value_or("");
  const bool is_ours =
      pid.empty() || number_from<std::uint64_t>(pid) == static_cast<std::uint64_t>(::getpid());
  if (!is_ours || !within_us || *within_us == 0 || *within_us > longest_us) return std::nullopt;
  return std::chrono::microseconds(*within_us) / 4;
}

}  // namespace fxagent::service_manager
