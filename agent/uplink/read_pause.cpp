#include "agent/uplink/read_pause.h"

#include <sys/socket.h>

#include <climits>

namespace fxagent {
namespace {

constexpr int kMostHeld = 128 << 10;  // bytes; the kernel doubles it for its own needs

/// 0: no socket, or a system that does not tell.
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
  // The kernel takes half of its buffer in place of what cannot be. With 1 again it tells at once
  // whoever waits, where something has come meanwhile.
  const int least = paused_ ? INT_MAX : 1;
  // The kernel would make room for megabytes, and what the peer sends after them waits behind.
  if (paused_) setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &kMostHeld, sizeof(kMostHeld));
  setsockopt(fd_, SOL_SOCKET, SO_RCVLOWAT, &least, sizeof(least));
}

}  // namespace fxagent
