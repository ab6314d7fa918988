#include "agent/field/transport/low_latency.h"

#include <linux/serial.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>

#include <fstream>
#include <string>

namespace fxagent {
namespace {

constexpr int kLeastTimerMs = 1;

bool set_flag(int fd) {
  serial_struct port{};
  if (ioctl(fd, TIOCGSERIAL, &port) != 0) return false;
  port.flags |= static_cast<int>(ASYNC_LOW_LATENCY);
  if (ioctl(fd, TIOCSSERIAL, &port) != 0 || ioctl(fd, TIOCGSERIAL, &port) != 0) return false;
  return (port.flags & static_cast<int>(ASYNC_LOW_LATENCY)) != 0;
}

std::optional<int> timer_of(const std::filesystem::path& file) {
  int timer_ms = 0;
  if (std::ifstream(file) >> timer_ms) return timer_ms;
  return std::nullopt;
}

}  // namespace

LowLatency ask_for_low_latency(int fd, const std::filesystem::path& devices) {
  LowLatency out;
  out.flag_taken = set_flag(fd);
  struct stat node {};
  if (fstat(fd, &node) != 0) return out;
  const auto number =
      std::to_string(major(node.st_rdev)) + ":" + std::to_string(minor(node.st_rdev));
  const auto file = devices / number / "device" / "latency_timer";
  out.timer_ms = timer_of(file);
  if (!out.timer_ms || *out.timer_ms <= kLeastTimerMs) return out;
  std::ofstream(file) << kLeastTimerMs << '\n';
  out.timer_ms = timer_of(file);
  return out;
}

}  // namespace fxagent
