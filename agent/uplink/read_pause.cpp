#include "agent/uplink/read_pause.h"

#include <dirent.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <climits>
#include <cstdlib>
#include <memory>
#include <new>

#include "agent/uplink/send_at_once.h"

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

void ReadPause::find(std::uint16_t port) noexcept {
  const std::unique_ptr<DIR, int (*)(DIR*)> open_files(opendir("/proc/self/fd"), closedir);
  if (!open_files) return;
  const std::lock_guard lock(mutex_);
  sockets_.clear();
  try {
    while (const dirent* entry = readdir(open_files.get())) {
      const int fd = std::atoi(entry->d_name);
      if (peer_port(fd) != port) continue;
      if (const std::uint64_t cookie = cookie_of(fd); cookie != 0) sockets_.push_back({fd, cookie});
    }
  } catch (const std::bad_alloc&) {
    // Without memory for a list there is no pause, and the messages are taken as they come.
  }
  if (paused_) apply();
}

void ReadPause::set(bool paused) noexcept {
  const std::lock_guard lock(mutex_);
  if (paused_ == paused) return;
  paused_ = paused;
  apply();
}

void ReadPause::apply() noexcept {
  // The kernel takes half of its buffer in place of what cannot be. With 1 again it tells at once
  // whoever waits, where something has come meanwhile.
  const int least = paused_ ? INT_MAX : 1;
  for (const Socket& socket : sockets_) {
    if (cookie_of(socket.fd) != socket.cookie) continue;
    // The kernel would make room for megabytes, and what the peer sends after them waits behind.
    if (paused_) setsockopt(socket.fd, SOL_SOCKET, SO_RCVBUF, &kMostHeld, sizeof(kMostHeld));
    setsockopt(socket.fd, SOL_SOCKET, SO_RCVLOWAT, &least, sizeof(least));
  }
}

}  // namespace fxagent
