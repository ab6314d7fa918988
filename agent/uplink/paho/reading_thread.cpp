// The dynamic linker searches the program before its libraries, so these definitions replace
// libc's. A library that still binds to libc's usleep() sleeps as before.
#include "agent/uplink/paho/reading_thread.h"

#include <dlfcn.h>
#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <ctime>
#include <mutex>
#include <optional>
#include <set>
#include <string_view>
#include <utility>
#include <vector>

namespace fxagent {
namespace {

constexpr useconds_t kIdleSleep = 100'000;
// Less than the 1 s of a poll() that waited, more than the 0.1 s between two sleeps of a loop whose
// poll() returns at once.
constexpr std::chrono::milliseconds kWaited{500};

thread_local std::optional<IdleSleeps> idle_sleeps;

bool has_name(std::string_view beginning) noexcept {
  std::array<char, 16> name{};  // pthread_setname_np(3): no name is longer
  return pthread_getname_np(pthread_self(), name.data(), name.size()) == 0 &&
         std::string_view(name.data()).starts_with(beginning);
}

/// The sockets of Paho whose connect() is in progress. If Paho closes one before it reads the
/// outcome, its number stays until Paho connects a socket with the same number.
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
  /// Waits as poll() does, but returns early when a socket is connected or a new one was inserted.
  int wait(pollfd* fds, nfds_t count, int timeout_ms) {
    thread_local std::vector<pollfd> all;
    all.assign(fds, fds + count);
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
  static auto* const sockets = new Connecting;  // never deleted: Paho's threads outlive main()
  return *sockets;
}

}  // namespace

bool is_paho_thread() noexcept { return has_name("MQTTAsync_"); }

void note_connect_outcome(int fd) noexcept {
  try {
    connecting().erase(fd);
  } catch (...) {
    // Out of memory: nothing has been inserted either.
  }
}

bool IdleSleeps::leaves_out(std::chrono::steady_clock::time_point now) noexcept {
  return now - std::exchange(asked_, now) >= kWaited;
}

void leave_out_idle_sleeps() noexcept { idle_sleeps.emplace(); }

}  // namespace fxagent

extern "C" {

int connect(int fd, const sockaddr* address, socklen_t size) {
  using Connect = int (*)(int, const sockaddr*, socklen_t);
  static const auto libc_connect = reinterpret_cast<Connect>(dlsym(RTLD_NEXT, "connect"));
  const bool is_paho = fxagent::is_paho_thread();
  if (is_paho) fxagent::note_connect_outcome(fd);  // of an earlier socket with this number
  const int outcome = libc_connect(fd, address, size);
  if (!is_paho || outcome == 0 || errno != EINPROGRESS) return outcome;
  try {
    fxagent::connecting().insert(fd);
  } catch (...) {
    // Out of memory: Paho notices the connection later.
  }
  errno = EINPROGRESS;
  return outcome;
}

int poll(pollfd* fds, nfds_t count, int timeout_ms) {
  // Only the thread that reads. Paho's other one resolves names, which may poll, too.
  thread_local const bool is_reading = fxagent::has_name("MQTTAsync_rcv");
  if (is_reading && timeout_ms > 0) {
    try {
      return fxagent::connecting().wait(fds, count, timeout_ms);
    } catch (...) {
      // Out of memory: waits as others do.
    }
  }
  const timespec time{timeout_ms / 1000, timeout_ms % 1000 * 1'000'000L};
  return ::ppoll(fds, count, timeout_ms < 0 ? nullptr : &time, nullptr);
}

int usleep(useconds_t microseconds) {
  if (microseconds == fxagent::kIdleSleep && fxagent::idle_sleeps &&
      fxagent::idle_sleeps->leaves_out(std::chrono::steady_clock::now()))
    return 0;
  constexpr useconds_t second = 1'000'000;
  const timespec time{static_cast<time_t>(microseconds / second),
                      static_cast<long>(microseconds % second) * 1000};
  return nanosleep(&time, nullptr);
}

}  // extern "C"
