// Backpressure on a TCP connection that a library reads. Makes the socket count as unreadable, so
// that the library's thread waits in poll() and holds none of its locks. What the peer sends stays
// in the kernel, then in the peer. Uses SO_RCVLOWAT, socket(7).
#pragma once

#include <cstdint>
#include <mutex>

namespace fxagent {

/// Any thread. Has no effect on systems without this option.
class ReadPause final {
 public:
  /// Selects the socket; -1: none.
  void watch(int fd) noexcept;
  /// Does not touch a socket that has been closed since, even if its number is in use again. A few
  /// more bytes may be read during a pause: those that the kernel has no room for, and those that
  /// TLS has already decrypted.
  void set(bool paused) noexcept;

 private:
  void apply() noexcept;

  std::mutex mutex_;
  int fd_ = -1;
  std::uint64_t cookie_ = 0;  ///< the kernel's own id of the socket, never used again; 0: none
  bool paused_ = false;
};

}  // namespace fxagent
