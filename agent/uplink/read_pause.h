// Backpressure on a TCP connection that a library reads: its socket is told to count as unreadable,
// so that the library's thread waits in poll() and holds none of its locks meanwhile. What the peer
// sends stays in the kernel, then in the peer. By SO_RCVLOWAT, socket(7).
#pragma once

#include <cstdint>
#include <mutex>
#include <vector>

namespace fxagent {

/// Any thread. Where the system has no such option nothing is paused.
class ReadPause final {
 public:
  /// From now on the sockets of this process that are connected to this port, in host order, are
  /// meant. The library hides which is its own.
  void find(std::uint16_t port) noexcept;
  /// A socket that was closed since is not touched, whoever has its number now. Some bytes more may
  /// be read in spite of a pause: what the kernel has no room for, and what TLS has unpacked.
  void set(bool paused) noexcept;

 private:
  struct Socket {
    int fd = -1;
    std::uint64_t cookie = 0;  ///< the kernel's own name of it, never used again
  };
  void apply() noexcept;

  std::mutex mutex_;
  std::vector<Socket> sockets_;
  bool paused_ = false;
};

}  // namespace fxagent
