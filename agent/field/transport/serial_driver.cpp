#include "agent/field/transport/serial_driver.h"

#include <linux/serial.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>

#include <cerrno>
#include <fstream>
#include <system_error>

namespace fxagent {
namespace {

constexpr auto kSwitchesItself =
    "; remove rs485 if the adapter switches on its own, otherwise use an adapter that does";

constexpr int kLeastLatencyTimerMs = 1;

bool set_low_latency_flag(int fd) {
  serial_struct port{};
  if (ioctl(fd, TIOCGSERIAL, &port) != 0) return false;
  port.flags |= static_cast<int>(ASYNC_LOW_LATENCY);
  if (ioctl(fd, TIOCSSERIAL, &port) != 0 || ioctl(fd, TIOCGSERIAL, &port) != 0) return false;
  return (port.flags & static_cast<int>(ASYNC_LOW_LATENCY)) != 0;
}

std::optional<int> latency_timer_of(const std::filesystem::path& file) {
  int timer_ms = 0;
  if (std::ifstream(file) >> timer_ms) return timer_ms;
  return std::nullopt;
}

}  // namespace

serial_rs485 kernel_settings(const Rs485& wish) {
  serial_rs485 out{};
  out.flags = SER_RS485_ENABLED;
  out.flags |= wish.rts_on_send ? SER_RS485_RTS_ON_SEND : SER_RS485_RTS_AFTER_SEND;
  out.delay_rts_before_send =
      static_cast<decltype(out.delay_rts_before_send)>(wish.delay_before.count());
  out.delay_rts_after_send =
      static_cast<decltype(out.delay_rts_after_send)>(wish.delay_after.count());
  return out;
}

std::string not_taken(const serial_rs485& asked, const serial_rs485& got) {
  if ((got.flags & SER_RS485_ENABLED) == 0)
    return std::string(
               "does not switch the RS-485 direction although its driver accepts the request") +
           kSwitchesItself;
  constexpr auto kWay = SER_RS485_RTS_ON_SEND | SER_RS485_RTS_AFTER_SEND;
  if ((got.flags & kWay) != (asked.flags & kWay))
    return (asked.flags & SER_RS485_RTS_ON_SEND) != 0
               ? "cannot raise RTS while it sends; set rs485/rts_on_send to false"
               : "cannot lower RTS while it sends; remove rs485/rts_on_send";
  const auto delay = [](const char* key, unsigned wanted, unsigned given) {
    return std::string("does not keep rs485/") + key + " " + std::to_string(wanted) +
           ", its driver changes it to " + std::to_string(given);
  };
  if (got.delay_rts_before_send != asked.delay_rts_before_send)
    return delay("delay_before_ms", asked.delay_rts_before_send, got.delay_rts_before_send);
  if (got.delay_rts_after_send != asked.delay_rts_after_send)
    return delay("delay_after_ms", asked.delay_rts_after_send, got.delay_rts_after_send);
  return {};
}

std::string switch_direction(int fd, const Rs485& wish) {
  const serial_rs485 asked = kernel_settings(wish);
  serial_rs485 got = asked;
  if (ioctl(fd, TIOCSRS485, &got) == 0) return not_taken(asked, got);
  if (errno == ENOTTY || errno == EOPNOTSUPP)
    return std::string(
               "cannot switch the RS-485 direction: its driver does not support it (TIOCSRS485)") +
           kSwitchesItself;
  return "does not switch the RS-485 direction: " + std::system_category().message(errno) +
         kSwitchesItself;
}

LowLatency ask_for_low_latency(int fd, const std::filesystem::path& devices) {
  LowLatency out;
  out.flag_taken = set_low_latency_flag(fd);
  struct stat node {};
  if (fstat(fd, &node) != 0) return out;
  const auto number =
      std::to_string(major(node.st_rdev)) + ":" + std::to_string(minor(node.st_rdev));
  const auto file = devices / number / "device" / "latency_timer";
  out.timer_ms = latency_timer_of(file);
  if (!out.timer_ms || *out.timer_ms <= kLeastLatencyTimerMs) return out;
  std::ofstream(file) << kLeastLatencyTimerMs << '\n';
  out.timer_ms = latency_timer_of(file);
  return out;
}

}  // namespace fxagent
