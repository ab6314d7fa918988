// The dynamic linker searches the program before its libraries, so these definitions replace
// libc's.
#include "agent/uplink/paho/connect_notice.h"

#include <dlfcn.h>
#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <ctime>
#include <mutex>
#include <set>
#include <string_view>
#include <vector>

namespace fxagent {
namespace {

/// Sockets of Paho whose connect() is in progress. One that Paho closes before it asks for the
/// outcome stays until its number is used again; it is in no poll() until then.
class Connecting final {
 public:
  void insert(int fd) {
    {
      const std::lock_guard lock(mutex_);
      sockets_.insert(fd);
    }
    ::eventfd_write(wake_, 1);
  }
  void erase(int fd) noexcept {
    const std::lock_guard lock(mutex_);
    sockets_.erase(fd);
  }
  /// Waits as poll() does, but returns early if a socket is connected or a new one is made.
  int wait(pollfd* fds, nfds_t count, int timeout_ms) {
    std::vector<pollfd> all(fds, fds + count);
    {
      const std::lock_guard lock(mutex_);
      for (pollfd& each : all)
        if (sockets_.contains(each.fd)) each.events |= POLLOUT;
    }
    all.push_back({.fd = wake_, .events = POLLIN, .revents = 0});
    const timespec time{timeout_ms / 1000, timeout_ms % 1000 * 1'000'000L};
    const int found = ::ppoll(all.data(), all.size(), &time, nullptr);
    if (found < 0) return found;
    if (all.back().revents != 0) {
      eventfd_t times = 0;
      ::eventfd_read(wake_, &times);
    }
    int ready = 0;
    for (nfds_t i = 0; i < count; ++i) {
      const int asked = fds[i].events | POLLERR | POLLHUP | POLLNVAL;
      fds[i].revents = static_cast<short>(all[i].revents & asked);
      if (fds[i].revents != 0) ++ready;
    }
    return ready;
  }

 private:
  std::mutex mutex_;
  std::set<int> sockets_;
  const int wake_ = ::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);  ///< -1: none, which poll() ignores
};

Connecting& connecting() {
  static Connecting* const sockets = new Connecting;  // Paho's threads may outlive main()
  return *sockets;
}

}  // namespace

bool is_paho_thread() noexcept {
  std::array<char, 16> name{};  // pthread_setname_np(3): no name is longer
  return pthread_getname_np(pthread_self(), name.data(), name.size()) == 0 &&
         std::string_view(name.data()).starts_with("MQTTAsync_");
}

void note_connect_outcome(int fd) noexcept { connecting().erase(fd); }

}  // namespace fxagent

extern "C" {

int connect(int fd, const sockaddr* address, socklen_t size) {
  using Connect = int (*)(int, const sockaddr*, socklen_t);
  static const auto libc_connect = reinterpret_cast<Connect>(dlsym(RTLD_NEXT, "connect"));
  const int outcome = libc_connect(fd, address, size);
  const int error = errno;
  if (outcome != 0 && error == EINPROGRESS && fxagent::is_paho_thread()) try {
      fxagent::connecting().insert(fd);
    } catch (...) {
      // Out of memory: Paho notices the connection later.
    }
  errno = error;
  return outcome;
}

int poll(pollfd* fds, nfds_t count, int timeout_ms) {
  if (timeout_ms > 0 && fxagent::is_paho_thread()) try {
      return fxagent::connecting().wait(fds, count, timeout_ms);
    } catch (...) {
      // Out of memory: an ordinary poll().
    }
  const timespec time{timeout_ms / 1000, timeout_ms % 1000 * 1'000'000L};
  return ::ppoll(fds, count, timeout_ms < 0 ? nullptr : &time, nullptr);
}

}  // extern "C"
