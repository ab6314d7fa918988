// The receiving end of sd_notify(3) and the environment that refers to it.
#pragma once

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>

namespace fxagent::test {

/// Sets an environment variable during its own lifetime.
class Variable {
 public:
  Variable(const char* name, const std::string& value) : name_(name) {
    ::setenv(name, value.c_str(), 1);
  }
  Variable(const Variable&) = delete;
  Variable& operator=(const Variable&) = delete;
  ~Variable() { ::unsetenv(name_); }

 private:
  const char* name_;
};

/// The service manager's end of the socket.
class Inbox {
 public:
  /// Binds to an abstract name chosen by the kernel.
  Inbox() : socket_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    ::bind(socket_, reinterpret_cast<sockaddr*>(&address), sizeof(sa_family_t));
    socklen_t size = sizeof address;
    ::getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size);
    name_ = "@" + std::string(&address.sun_path[1], size - sizeof(sa_family_t) - 1);
  }
  /// Binds to a path, or to an abstract name preceded by @; at most 108 bytes.
  explicit Inbox(const std::string& name)
      : socket_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0)), name_(name) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::copy(name.begin(), name.end(), address.sun_path);
    if (name.front() == '@') address.sun_path[0] = '\0';
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
    if (::bind(socket_, reinterpret_cast<sockaddr*>(&address), size) != 0)
      ADD_FAILURE() << name << ": " << std::strerror(errno);
  }
  Inbox(const Inbox&) = delete;
  Inbox& operator=(const Inbox&) = delete;
  ~Inbox() {
    ::close(socket_);
    if (name_.front() == '/') ::unlink(name_.c_str());
  }

  const std::string& name() const { return name_; }
  /// Sends a text to this inbox. Returns false if it is full.
  bool put(const std::string& text) const {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::copy(name_.begin(), name_.end(), address.sun_path);
    if (name_.front() == '@') address.sun_path[0] = '\0';
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name_.size());
    const int out = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    const auto sent = ::sendto(out, text.data(), text.size(), MSG_DONTWAIT,
                               reinterpret_cast<const sockaddr*>(&address), size);
    ::close(out);
    return sent >= 0;
  }
  /// Returns the next message, or an empty string if there is none.
  std::string next() {
    std::array<char, 4096> text{};
    const auto size = ::recv(socket_, text.data(), text.size(), 0);
    return size < 0 ? std::string() : std::string(text.data(), static_cast<std::size_t>(size));
  }
  /// Returns all messages received so far.
  std::vector<std::string> all() {
    std::vector<std::string> texts;
    for (std::string text = next(); !text.empty(); text = next()) texts.push_back(text);
    return texts;
  }

 private:
  int socket_;
  std::string name_;
};

}  // namespace fxagent::test
