// A pseudo terminal under a chosen name: a serial port without a cable.
#pragma once

#include <string>
#include <string_view>

namespace fxsim {

/// Owns both ends. The client's end stays open here too, so the terminal keeps its raw mode and
/// survives a client that closes and reopens it.
class Pty final {
 public:
  /// Creates the terminal and a symbolic link to it at `link`, replacing an existing link.
  /// Throws std::system_error, also if `link` exists and is not a symbolic link.
  explicit Pty(std::string link);
  /// Removes the link if it still points to this terminal.
  ~Pty();
  Pty(const Pty&) = delete;
  Pty& operator=(const Pty&) = delete;

  int master() const { return master_; }
  /// True if the client's end is set to this speed, parity and number of stop bits. A terminal
  /// keeps them all except the number of data bits; of parity it keeps INPCK and PARODD.
  bool client_is_set_to(unsigned baud, std::string_view parity, bool two_stop_bits) const;
  /// Readable when a client has opened or closed its end.
  int watch() const { return watch_; }
  /// Call when watch() is readable, and before answering a request. After a client has closed,
  /// discards its unread bytes and releases its exclusive lock, as closing a real port does. A
  /// client that reopens within the same millisecond may still read the old bytes.
  void notice_closing();

 private:
  void close_all() noexcept;

  std::string link_;
  std::string device_;
  int master_ = -1;
  int slave_ = -1;
  int watch_ = -1;
};

}  // namespace fxsim
