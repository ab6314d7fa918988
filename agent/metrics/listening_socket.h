// The socket on which metrics are served: TCP or a Unix socket, ready to accept. Any thread.
#pragma once

#include <string>
#include <utility>

#include "agent/config/config.h"
#include "protocol/result.h"

namespace fxagent {

class ListeningSocket final {
 public:
  /// Opens it. Of a Unix socket that nobody listens on any more the file is replaced. Errors:
  /// link_down, with the cure: the address is taken, is none of this machine, or may not be used.
  static Result<ListeningSocket> open(const MetricsConfig& config);

  ListeningSocket(ListeningSocket&& other) noexcept
      : file_(std::exchange(other.file_, -1)),
        address_(std::move(other.address_)),
        path_(std::exchange(other.path_, {})) {}
  ListeningSocket& operator=(ListeningSocket&&) = delete;
  /// Closes it where nobody took it, and removes the file of a Unix socket.
  ~ListeningSocket();

  /// Who closes it now is the caller.
  int take_file() { return std::exchange(file_, -1); }
  /// As it is: "127.0.0.1:9464", "[::1]:40123", "unix:/run/fxagent/metrics".
  const std::string& address() const { return address_; }

 private:
  explicit ListeningSocket(int file) : file_(file) {}

  static Result<ListeningSocket> open_unix(const std::string& path);
  static Result<ListeningSocket> open_tcp(const MetricsConfig& config);

  int file_;
  std::string address_;
  std::string path_;  ///< of a Unix socket that was bound
};

}  // namespace fxagent
