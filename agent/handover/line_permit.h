// Permission of a gateway in a pair to send on its lines. The pair's thread grants it for a short
// time and renews it; the field reads it before each write, the uplink before each publication.
// Any thread.
//
// Times are of CLOCK_BOOTTIME, which also runs while the machine is suspended: a process that was
// stopped for a minute wakes with a permission that has run out.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <ctime>

namespace fxagent {

/// Time since the boot of the machine.
using BootTime = std::chrono::nanoseconds;
/// Reads CLOCK_BOOTTIME.
inline BootTime boot_time_now() {
  timespec time{};
  clock_gettime(CLOCK_BOOTTIME, &time);
  return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}

class LinePermit final {
 public:
  /// `quiet`: silence that a line needs after bytes of another master.
  explicit LinePermit(std::chrono::nanoseconds quiet) : quiet_(quiet) {}

  /// Lets the field send from `opens_at` on, while the permission lasts.
  void open_at(BootTime opens_at) { opens_at_.store(opens_at.count()); }
  /// The permission lasts until `until`.
  void extend(BootTime until) { until_.store(until.count()); }
  /// Ends the permission at once.
  void revoke() { until_.store(0); }

  /// True while this gateway is the holder.
  bool holds(BootTime now) const { return now.count() < until_.load(); }
  /// True while a request may be sent.
  bool may_send(BootTime now) const { return holds(now) && now >= opens_at(); }
  /// True if the permission was renewed by something that this gateway sent after `t`.
  bool was_confirmed_after(BootTime t) const {
    return until_.load() - quiet_.count() / 2 > t.count();
  }
  BootTime opens_at() const { return BootTime(opens_at_.load()); }
  std::chrono::nanoseconds quiet() const { return quiet_; }

 private:
  const std::chrono::nanoseconds quiet_;
  std::atomic<std::int64_t> opens_at_{0};
  std::atomic<std::int64_t> until_{0};
};

}  // namespace fxagent
