// A pseudo terminal under a name of our choice: a serial port without a cable.
#pragma once

#include <string>

namespace fxsim {

/// Owns both ends. The client's end stays open here too, so that the terminal keeps its raw mode
/// and outlives a client that closes and opens it again.
class Pty final {
 public:
  /// Makes the terminal and a symbolic link to it at `link`, replacing a link that is there.
  /// Throws std::system_error, also where `link` is something else than a link.
  explicit Pty(std::string link);
  /// Removes the link if it is still ours.
  ~Pty();
  Pty(const Pty&) = delete;
  Pty& operator=(const Pty&) = delete;

  int master() const { return master_; }
  /// Readable when a client has opened or closed its end.
  int watch() const { return watch_; }
  /// Call when watch() is readable, and before a request is answered. After a client has closed,
  /// what it has not read is dropped and its exclusive lock undone, as a port that closes does. A
  /// client that opens again within the same millisecond may still find the old bytes.
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
