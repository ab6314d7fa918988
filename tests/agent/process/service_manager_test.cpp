#include "agent/process/service_manager.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdlib>
#include <optional>
#include <string>

namespace fxagent {
namespace {

/// An environment variable for as long as this lives.
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

/// The service manager's end. It has an abstract name, which the kernel gives it.
class Inbox {
 public:
  Inbox() : socket_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    ::bind(socket_, reinterpret_cast<sockaddr*>(&address), sizeof(sa_family_t));
    socklen_t size = sizeof address;
    ::getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size);
    name_ = "@" + std::string(&address.sun_path[1], size - sizeof(sa_family_t) - 1);
  }
  Inbox(const Inbox&) = delete;
  Inbox& operator=(const Inbox&) = delete;
  ~Inbox() { ::close(socket_); }

  const std::string& name() const { return name_; }
  std::string next() {
    std::array<char, 64> text{};
    const auto size = ::recv(socket_, text.data(), text.size(), 0);
    return size < 0 ? std::string() : std::string(text.data(), static_cast<std::size_t>(size));
  }

 private:
  int socket_;
  std::string name_;
};

TEST(ServiceManager, IsToldOnItsSocket) {
  Inbox inbox;
  const Variable socket("NOTIFY_SOCKET", inbox.name());
  service_manager::tell_ready();
  service_manager::tell_alive();
  service_manager::tell_stopping();
  EXPECT_EQ(inbox.next(), "READY=1");
  EXPECT_EQ(inbox.next(), "WATCHDOG=1");
  EXPECT_EQ(inbox.next(), "STOPPING=1");
  EXPECT_EQ(inbox.next(), "");
}

TEST(ServiceManager, WithoutASocketNothingHappens) {
  for (const std::string& name : {std::string(), std::string("relative"), std::string("/no/such"),
                                  "/" + std::string(300, 'x')}) {
    const Variable socket("NOTIFY_SOCKET", name);
    service_manager::tell_ready();
  }
}

TEST(ServiceManager, WatchdogIsFedFourTimesInItsTime) {
  ::unsetenv("WATCHDOG_USEC");  // of whoever runs the test
  ::unsetenv("WATCHDOG_PID");
  EXPECT_EQ(service_manager::watchdog_interval(), std::nullopt);
  const Variable within("WATCHDOG_USEC", "1200000");
  EXPECT_EQ(service_manager::watchdog_interval(), std::chrono::milliseconds(300));
  const Variable ours("WATCHDOG_PID", std::to_string(::getpid()));
  EXPECT_EQ(service_manager::watchdog_interval(), std::chrono::milliseconds(300));
}

TEST(ServiceManager, WatchdogOfAnotherProcessOrWithoutATimeIsNone) {
  for (const std::string within : {"0", "", "-1", "12s", "18446744073709551615"}) {
    const Variable time("WATCHDOG_USEC", within);
    EXPECT_EQ(service_manager::watchdog_interval(), std::nullopt) << within;
  }
  const Variable within("WATCHDOG_USEC", "1200000");
  const Variable other("WATCHDOG_PID", "1");
  EXPECT_EQ(service_manager::watchdog_interval(), std::nullopt);
}

}  // namespace
}  // namespace fxagent
