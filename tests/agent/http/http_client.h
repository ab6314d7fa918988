// A non-blocking client that sends any bytes at any pace, for the tests of the HTTP server.
#pragma once

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <string>
#include <string_view>
#include <utility>

namespace fxagent::test {

class HttpClient final {
 public:
  /// Connects to a Unix socket.
  explicit HttpClient(const std::string& path)
      : file_(::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.copy(address.sun_path, sizeof address.sun_path - 1);
    connected_ = ::connect(file_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  }
  HttpClient(HttpClient&& other) noexcept
      : file_(std::exchange(other.file_, -1)),
        connected_(other.connected_),
        closed_(other.closed_),
        heard_(std::move(other.heard_)) {}
  HttpClient& operator=(HttpClient&&) = delete;
  ~HttpClient() {
    if (file_ >= 0) ::close(file_);
  }

  bool connected() const { return connected_; }
  void send(std::string_view text) const {
    ::send(file_, text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  }
  void end_sending() const { ::shutdown(file_, SHUT_WR); }

  /// Returns everything received so far.
  const std::string& heard() {
    std::array<char, 4096> block{};
    while (!closed_) {
      const auto count = ::recv(file_, block.data(), block.size(), MSG_DONTWAIT);
      if (count > 0) {
        heard_.append(block.data(), static_cast<std::size_t>(count));
      } else {
        closed_ = count == 0 || (errno != EAGAIN && errno != EINTR);
        break;
      }
    }
    return heard_;
  }
  /// True if the server has closed the connection.
  bool closed() {
    heard();
    return closed_;
  }
  /// The status of the answer; 0 if there is none yet.
  int status() { return heard().starts_with("HTTP/1.1 ") ? std::stoi(heard().substr(9, 3)) : 0; }
  std::string body() {
    const auto end = heard().find("\r\n\r\n");
    return end == std::string::npos ? std::string() : heard().substr(end + 4);
  }

 private:
  int file_;
  bool connected_ = false;
  bool closed_ = false;
  std::string heard_;
};

}  // namespace fxagent::test
