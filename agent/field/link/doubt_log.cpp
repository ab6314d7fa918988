#include "agent/field/link/doubt_log.h"

#include <string>

#include "agent/field/bus/unexpected_bytes.h"
#include "agent/log/log.h"

namespace fxagent {
namespace {

using Clock = std::chrono::steady_clock;

// A recurring doubt is logged at most this often; each one is counted.
constexpr std::chrono::seconds kDoubtLoggedEvery{60};

/// Returns what the last unexpected bytes look like; empty: unknown.
std::string what_nobody_asked_for(const LinkDevices& devices, const Bus& bus) {
  if (devices.empty()) return {};
  const LinkDevice& device = *devices.front();
  const UnexpectedBytes guess =
      looks_like(device.config, *device.codec, ByteView(), bus.last_unexpected());
  return guess.cause == UnexpectedBytes::Cause::unknown ? "" : "; they look like " + guess.text;
}

}  // namespace

void DoubtLog::look() {
  if (bus_.echo_found() && !echo_logged_) {
    echo_logged_ = true;
    log::warn("link", {{"link", link_.name},
                       {"echo", "found"},
                       {"note",
                        "set echo for its devices: until three reads have shown the echo, the echo "
                        "of a command may pass for its answer"}});
  }
  if (!unexpected_logged_ && !bus_.last_unexpected().empty()) {
    unexpected_logged_ = true;
    log::warn("link", {{"link", link_.name},
                       {"unexpected", first_bytes(bus_.last_unexpected())},
                       {"note", "unexpected bytes; health counts them from now on" +
                                    what_nobody_asked_for(devices_, bus_)}});
  }
  const bool doubted = bus_.doubt().is_doubted();
  if (doubted == doubt_logged_) return;
  const auto now = Clock::now();
  if (doubted && doubt_logged_at_ && now - *doubt_logged_at_ < kDoubtLoggedEvery) return;
  doubt_logged_ = doubted;
  if (doubted) {
    doubt_logged_at_ = now;
    log::warn("link", {{"link", link_.name},
                       {"state", "doubted"},
                       {"unexpected", first_bytes(bus_.last_unexpected())},
                       {"note",
                        "another master, or late answers? Until several exchanges in a row are "
                        "clean, values are bad_frame and no ACK counts"}});
  } else {
    log::info("link", {{"link", link_.name}, {"state", "believed again"}});
  }
}

}  // namespace fxagent
