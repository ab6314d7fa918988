// The listening socket of the web server, TCP or Unix. Any thread.
#pragma once

#include <string>
#include <utility>

#include "agent/config/model.h"
#include "agent/file_handle.h"
#include "protocol/value/result.h"

namespace fxagent {

class ListeningSocket final {
 public:
  /// Opens the socket. Replaces the file of a Unix socket if no program listens on it any more.
  /// Errors: link_down, with the remedy: the address is in use, not on this machine, or not
  /// permitted.
  static Result<ListeningSocket> open(const HttpConfig& config);

  ListeningSocket(ListeningSocket&& other) noexcept
      : file_(std::move(other.file_)),
        address_(std::move(other.address_)),
        path_(std::exchange(other.path_, {})) {}
  ListeningSocket& operator=(ListeningSocket&&) = delete;
  /// Closes the socket unless take_file() was called, and removes the file of a Unix socket.
  ~ListeningSocket() { remove_path(); }

  /// Removes the file of a Unix socket. Call it before the socket is closed: afterwards the path
  /// may be another process's.
  void remove_path();
  /// Passes the socket to the caller, who calls remove_path() and closes it.
  int take_file() { return file_.release(); }
  /// Actual address: "127.0.0.1:9464", "[::1]:40123", "unix:/run/fxagent/metrics".
  const std::string& address() const { return address_; }

 private:
  explicit ListeningSocket(int file) : file_(file) {}

  static Result<ListeningSocket> open_unix(const std::string& path);
  static Result<ListeningSocket> open_tcp(const HttpConfig& config);

  FileHandle file_;
  std::string address_;
  std::string path_;  ///< of a bound Unix socket
};

}  // namespace fxagent
