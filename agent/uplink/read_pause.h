// Backpressure on a TCP connection that a library reads: its socket is told to count as unreadable,
// so that the library's thread waits in poll() and holds none of its locks meanwhile. What the peer
// sends stays in the kernel, then in the peer. By SO_RCVLOWAT, socket(7).
#pragma once

#include <cstdint>
#include <mutex>

namespace fxagent {

/// Any thread. Where the system has no such option nothing is paused.
class ReadPause final {
 public:
  /// From now on this socket is meant; -1: none.
  void watch(int fd) noexcept;
  /// A socket that was closed since is not touched, whoever has its number now. Some bytes more may
  /// be read in spite of a pause: what the kernel has no room for, and what TLS has unpacked.
  void set(bool paused) noexcept;

 private:
  void apply() noexcept;

  std::mutex mutex_;
  int fd_ = -1;
  std::uint64_t cookie_ = 0;  ///< the kernel's own name of the socket, never used again; 0: none
  bool paused_ = false;
};

}  // namespace fxagent
