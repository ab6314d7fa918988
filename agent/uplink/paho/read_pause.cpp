#include "agent/uplink/paho/read_pause.h"

#include <sys/socket.h>

#include <climits>

namespace fxagent {
namespace {

constexpr int kMostHeld = 128 << 10;  // bytes; the kernel doubles it for its own overhead

/// Returns 0 if `fd` is not a socket or the system has no cookies.
std::uint64_t cookie_of(int fd) {
  std::uint64_t cookie = 0;
  socklen_t length = sizeof(cookie);
  return getsockopt(fd, SOL_SOCKET, SO_COOKIE, &cookie, &length) == 0 ? cookie : 0;
}

}  // namespace

void ReadPause::watch(int fd) noexcept {
  const std::lock_guard lock(mutex_);
  fd_ = fd;
  cookie_ = cookie_of(fd);
  if (paused_) apply();
}

void ReadPause::set(bool paused) noexcept {
  const std::lock_guard lock(mutex_);
  if (paused_ == paused) return;
  paused_ = paused;
  apply();
}

void ReadPause::apply() noexcept {
  if (cookie_ == 0 || cookie_of(fd_) != cookie_) return;
  // The kernel reduces INT_MAX to half of its buffer. When the value becomes 1 again, it wakes a
  // waiting poll() at once if data has arrived.
  const int least = paused_ ? INT_MAX : 1;
  // Without a limit the kernel would buffer megabytes, and later packets of the peer would wait
  // behind them.
  if (paused_) setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &kMostHeld, sizeof(kMostHeld));
  setsockopt(fd_, SOL_SOCKET, SO_RCVLOWAT, &least, sizeof(least));
}

}  // namespace fxagent
